"""What is kept or shown of texts that come from elsewhere: no secrets, and nothing that a terminal would obey."""

from __future__ import annotations

import re

__all__ = ["escape_control_chars", "redacted"]

_CONFIG = re.compile(r"(?<![\w/])((?:tcp|tls|quic|udp|ws|unixsock-stream|serial)/[^\s#'\",]+)#[^\s'\",]*")
_USER = re.compile(r"\b([a-z][a-z0-9+.-]*://)[^\s/@'\"]+@")


def redacted(text: str) -> str:
    """Return a text in which endpoints end at their `#`, and URLs name no user.

    `tls/host:1#a=b;c=d` becomes `tls/host:1#...`: keys and passwords may stand there, and their names tell enough.
    """
    if "#" in text:
        text = _CONFIG.sub(r"\1#...", text)
    return _USER.sub(r"\1...@", text) if "://" in text else text


def escape_control_chars(text: object, *, keep: str = "") -> str:
    r"""Return text with escapes in place of what a terminal would obey.

    Args:
        text: Any.
        keep: What stays as it is nevertheless, such as line breaks.

    Example:
        >>> escape_control_chars("a\x1b[31m")
        'a\\x1b[31m'
    """
    plain = str(text)
    if plain.isprintable():
        return plain
    return "".join(each if each.isprintable() or each in keep else _escaped(each) for each in plain)


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape", "surrogatepass").decode()
