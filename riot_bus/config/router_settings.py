"""`[router]` in riot.toml: what the router is made of, as plain data. Nothing here starts Zenoh.

A table from a file gets its types from pydantic, which a router without a file does not have to load.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import combinations
from typing import Any, ClassVar

from riot_bus.config.endpoints import Endpoint, overlap, parse_endpoint
from riot_bus.config.toml_file import MistakeError
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

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
_LONGEST_BUDGET_S = 86_400.0  # a day: more is probably a wrong unit, such as milliseconds
_STRICT = {"extra": "forbid", "allow_inf_nan": False}


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentSettings:
    """`[router.segments.NAME]`: one isolated router of the bus.

    Attributes:
        listen: Endpoints for components; none means a free port of this machine.
        connect: Routers or peers outside that the segment joins.
        config: Further Zenoh configuration: keys joined by `/`, and JSON values.

    Raises:
        MistakeError: An endpoint or a setting cannot work.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    config: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("listen", "connect"):
            object.__setattr__(self, name, _checked_endpoints(getattr(self, name), name))
        for key, value in self.config.items():
            _check_setting(key, value)

    @property
    def listeners(self) -> tuple[Endpoint, ...]:
        """The parsed endpoints of `listen`."""
        return tuple(parse_endpoint(text) for text in self.listen)

    @property
    def is_local(self) -> bool:
        """Whether only this machine reaches it: it listens on loopback or socket files, and joins none elsewhere."""
        scouting = any(
            key.startswith("scouting/multicast") and value is not False for key, value in self.config.items()
        )
        connected = (parse_endpoint(text, connect=True) for text in self.connect)
        return not scouting and all(each.is_local for each in (*self.listeners, *connected))


@dataclass(frozen=True, slots=True, kw_only=True)
class RouterSettings:
    """`[router]`: name, segments, and what is done to the traffic between them.

    Attributes:
        name: The router answers under `@riot/<name>/**`.
        intercept: Topics or key expressions that are intercepted.
        services: Services and actions whose requests and replies are intercepted; names or key expressions.
        record: File to record to.
        budget: Seconds that an interceptor may block.
        control: Segments whose components may control the router; None means those that only this machine reaches.
        segments: Empty means `DEFAULT_SEGMENTS`.
        interceptors: Tables as they were written; their keys are known to whatever builds interceptors.

    Raises:
        MistakeError: A value cannot work, or segments conflict.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    name: str = "router"
    intercept: tuple[str, ...] = ()
    services: tuple[str, ...] = ()
    record: str | None = None
    budget: float = 1.0
    control: tuple[str, ...] | None = None
    segments: dict[str, SegmentSettings] = field(default_factory=dict)
    interceptors: tuple[dict[str, Any], ...] = ()

    def __post_init__(self) -> None:
        _check_name(self.name, "name")
        for word in ("intercept", "services"):
            for number, text in enumerate(getattr(self, word)):
                _check_text(text, word, str(number))
        if self.record is not None:
            _check_text(self.record, "record")
        if not 0 < self.budget <= _LONGEST_BUDGET_S:
            text = f"budget should be greater than 0 and at most {_LONGEST_BUDGET_S:g} (got {self.budget!r})"
            raise MistakeError(text, hint="write seconds", place=["budget"])
        for number, name in enumerate(self.control or ()):
            _check_name(name, "control", str(number))
            if self.segments and name not in self.segments:
                known = did_you_mean(name, self.segments)
                raise MistakeError(f"no segment {name!r}", hint=known, place=["control", str(number)])
        for name in self.segments:
            _check_name(name, "segments", name)
        _check_apart(self.segments)

    @property
    def controlled_from(self) -> tuple[str, ...]:
        """Names of the segments whose components may control the router."""
        if self.control is not None:
            return self.control
        return tuple(name for name, segment in self.segments.items() if segment.is_local)

    def segment(self, name: str) -> SegmentSettings:
        """Return a segment's settings.

        Raises:
            ConfigError: There is none of this name.
        """
        try:
            return self.segments[name]
        except KeyError:
            raise ConfigError(f"no segment {name!r}", hint=did_you_mean(name, self.segments)) from None


def router_keys(place: Sequence[str]) -> list[str]:
    """Return the keys of a table at or below `[router]`; none where any key is allowed."""
    if len(place) == 1:
        return [each.name for each in fields(RouterSettings)]
    if len(place) == 3 and place[1] == "segments":
        return [each.name for each in fields(SegmentSettings)]
    return []


def _check_apart(segments: Mapping[str, SegmentSettings]) -> None:
    """Raise MistakeError if two segments listen on the same endpoint, or are connected elsewhere."""
    for (a, first), (b, second) in combinations(segments.items(), 2):
        for mine in first.listeners:
            for other in second.listeners:
                if overlap(mine, other):
                    text = f"segments {a!r} and {b!r} both listen on {other}"
                    hint = "each segment needs a port of its own"
                    raise MistakeError(text, hint=hint, place=["segments", b, "listen"])
        for text in set(first.connect) & set(second.connect):
            raise MistakeError(
                f"segments {a!r} and {b!r} both connect to {text}",
                hint="what they have in common would pass there, around the interceptors",
                place=["segments", b, "connect"],
            )
    for name, segment in segments.items():
        for text in segment.connect:
            outside = parse_endpoint(text)
            for other_name, own in segments.items():
                if any(overlap(outside, listener) and outside.is_local for listener in own.listeners):
                    raise MistakeError(
                        f"segment {name!r} connects to {text}, which is segment {other_name!r} of this router",
                        hint="riot joins its segments itself",
                        place=["segments", name, "connect"],
                    )


def _check_text(text: str, *place: str) -> None:
    """Raise MistakeError if a text is empty; `place` are the keys that lead to it."""
    if not text:
        raise MistakeError(f"{place[0]} should not be empty", hint="leave it out", place=place)


def _check_name(name: str, *place: str) -> None:
    """Raise MistakeError if a router or a segment cannot be called that."""
    if not re.fullmatch(SEGMENT_NAME, name):
        hint = "write letters, digits, '_', '.' and '-', such as unit-2"
        raise MistakeError(
            f"{name!r} is not a name: it should match the pattern {SEGMENT_NAME}", hint=hint, place=place
        )


def _checked_endpoints(texts: Sequence[str], place: str) -> tuple[str, ...]:
    """Return endpoints in the form for Zenoh; raises MistakeError if one cannot work."""
    try:
        return tuple(str(parse_endpoint(text, connect=place == "connect")) for text in texts)
    except ConfigError as error:
        raise MistakeError(error.message, hint=error.hint, place=[place]) from None


def forbidden(key: str, value: Any) -> str | None:
    """Return why a segment cannot have this setting, or None if it can."""
    if key in _NEEDED and value is False:
        return "it cannot be false: riot asks there where a segment listens"
    return _FORBIDDEN.get(key.strip("/"))


def _check_setting(key: str, value: Any) -> None:
    """Raise MistakeError if a segment cannot have this Zenoh setting."""
    why = forbidden(key, value)
    if why is not None:
        raise MistakeError(f"{key!r} cannot be set here", hint=why, place=["config", key])
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError):
        hint = "write text, a finite number, true, false, a list or a table"
        raise MistakeError(f"Zenoh has no such value: {value!r}", hint=hint, place=["config", key]) from None


DEFAULT_SEGMENTS = {
    "system": SegmentSettings(listen=("tcp/127.0.0.1:7447",)),
    "unit": SegmentSettings(listen=("tcp/127.0.0.1:7448",)),
}
