"""`[router]` in riot.toml: what the router is made of, as plain data. Nothing here starts Zenoh.

A table from a file gets its types from pydantic, which a router without a file does not have to load.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from itertools import combinations
from typing import TYPE_CHECKING, Any, ClassVar

from riot_bus.config.endpoints import Endpoint, overlap, parse_endpoint
from riot_bus.config.setting_checks import check_name, check_setting, check_text, checked_endpoints
from riot_bus.config.toml_file import MistakeError
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["DEFAULT_SEGMENTS", "RouterSettings", "SegmentSettings", "router_keys"]

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
            object.__setattr__(self, name, checked_endpoints(getattr(self, name), name))
        for key, value in self.config.items():
            check_setting(key, value)

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


DEFAULT_SEGMENTS = {
    "system": SegmentSettings(listen=("tcp/127.0.0.1:7447",)),
    "unit": SegmentSettings(listen=("tcp/127.0.0.1:7448",)),
}


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
        check_name(self.name, "name")
        for word in ("intercept", "services"):
            for number, text in enumerate(getattr(self, word)):
                check_text(text, word, str(number))
        if self.record is not None:
            check_text(self.record, "record")
        if not 0 < self.budget <= _LONGEST_BUDGET_S:
            text = f"budget should be greater than 0 and at most {_LONGEST_BUDGET_S:g} (got {self.budget!r})"
            raise MistakeError(text, hint="write seconds", place=["budget"])
        for number, name in enumerate(self.control or ()):
            check_name(name, "control", str(number))
            if self.segments and name not in self.segments:
                known = did_you_mean(name, self.segments)
                raise MistakeError(f"no segment {name!r}", hint=known, place=["control", str(number)])
        for name in self.segments:
            check_name(name, "segments", name)
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
    """Return the keys of a table at or below `[router]`; none where any key is allowed.

    Args:
        place: Keys from `router` on.
    """
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
