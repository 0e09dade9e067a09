"""Patterns that name fields in riot.toml and dictionaries: `scan:ranges[*]`, `*:header.frame_id`."""

from __future__ import annotations

from fnmatch import fnmatchcase


def names_field(pattern: str, name: str) -> bool:
    """Return whether a pattern matches the name of a field.

    Args:
        pattern: Pattern `topic:path`, where `*` matches any text and `?` any character; brackets are indices.
        name: Name `topic:path` of the field.

    Example:
        >>> names_field("scan:ranges[3]", "scan:ranges[3]"), names_field("scan:ranges[*]", "scan:ranges[12]")
        (True, True)
    """
    return fnmatchcase(name, pattern.replace("[", "[[]"))
