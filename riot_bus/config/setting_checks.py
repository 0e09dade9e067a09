"""Checks of what the tables of `[router]` must not contain."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

from riot_bus.config.endpoints import parse_endpoint
from riot_bus.config.toml_file import MistakeError
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Sequence


__all__ = ["SEGMENT_NAME", "check_name", "check_setting", "check_text", "checked_endpoints", "forbidden"]

SEGMENT_NAME = r"[A-Za-z0-9_][A-Za-z0-9_.-]*"

_LISTEN = "write listen = [...] in the segment's table"
_CONNECT = "write connect = [...] in the segment's table"
_PASSWORD = (
    "the segment would refuse all clients without a password, riot's own sessions too; dictionary_file names users"  # noqa: S105
)
_FORBIDDEN = {
    "mode": "a segment is always a router",
    "namespace": "a segment sees the keys as its components write them",
    "listen": _LISTEN,
    "listen/endpoints": _LISTEN,
    "connect": _CONNECT,
    "connect/endpoints": _CONNECT,
    "transport/auth/usrpwd/user": _PASSWORD,
    "transport/auth/usrpwd/password": _PASSWORD,
}
_NEEDED = ("adminspace/enabled", "adminspace/permissions/read")


def check_text(text: str, *place: str) -> None:
    """Raise MistakeError if a text is empty; `place` are the keys that lead to it."""
    if not text:
        raise MistakeError(f"{place[0]} should not be empty", hint="leave it out", place=place)


def check_name(name: str, *place: str) -> None:
    """Raise MistakeError if a router or a segment cannot be called that."""
    if not re.fullmatch(SEGMENT_NAME, name):
        hint = "write letters, digits, '_', '.' and '-', such as unit-2"
        raise MistakeError(
            f"{name!r} is not a name: it should match the pattern {SEGMENT_NAME}", hint=hint, place=place
        )


def checked_endpoints(texts: Sequence[str], place: str) -> tuple[str, ...]:
    """Return endpoints in the form for Zenoh; raises MistakeError if one cannot work.

    Args:
        texts: Endpoints as the user wrote them.
        place: `listen` or `connect`.
    """
    try:
        return tuple(str(parse_endpoint(text, connect=place == "connect")) for text in texts)
    except ConfigError as error:
        raise MistakeError(error.message, hint=error.hint, place=[place]) from None


def forbidden(key: str, value: Any) -> str | None:
    """Return why a segment cannot have this setting, or None if it can."""
    if key in _NEEDED and value is False:
        return "it cannot be false: riot asks there where a segment listens"
    return _FORBIDDEN.get(key.strip("/"))


def check_setting(key: str, value: Any) -> None:
    """Raise MistakeError if a segment cannot have this Zenoh setting."""
    why = forbidden(key, value)
    if why is not None:
        raise MistakeError(f"{key!r} cannot be set here", hint=why, place=["config", key])
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError):
        hint = "write text, a finite number, true, false, a list or a table"
        raise MistakeError(f"Zenoh has no such value: {value!r}", hint=hint, place=["config", key]) from None
