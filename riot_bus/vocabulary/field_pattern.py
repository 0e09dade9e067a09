"""Patterns that name fields in riot.toml and dictionaries: `scan:ranges[*]`, `*:header.frame_id`."""

from __future__ import annotations

from fnmatch import fnmatchcase

__all__ = ["names_field"]


def names_field(pattern: str, name: str) -> bool:
    """Return whether a pattern names a field.

    Args:
        pattern: `topic:path`, where `*` stands for any text and `?` for any letter; brackets are indices.
        name: `topic:path` of the field.

    Example:
        >>> names_field("scan:ranges[3]", "scan:ranges[3]"), names_field("scan:ranges[*]", "scan:ranges[12]")
        (True, True)
    """
    return fnmatchcase(name, pattern.replace("[", "[[]"))
