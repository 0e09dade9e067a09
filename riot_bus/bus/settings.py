"""`[router]` in riot.toml: what the router is made of, as plain data. Nothing here starts Zenoh."""

from __future__ import annotations

import json
from itertools import combinations
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator

from riot_bus.bus.endpoints import Endpoint, overlap, parse_endpoint
from riot_bus.bus.files import with_files
from riot_bus.bus.tomlfile import explained, mistake, read_toml
from riot_bus.bus.zenoh_keys import forbidden
from riot_bus.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

__all__ = ["DEFAULT_SEGMENTS", "RouterSettings", "SegmentName", "SegmentSettings", "load_router", "router_keys"]

SEGMENT_NAME = r"[A-Za-z0-9_][A-Za-z0-9_.-]*"
SegmentName = Annotated[str, Field(pattern=f"^{SEGMENT_NAME}$")]

_Text = Annotated[str, Field(min_length=1)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class SegmentSettings(_Table):
    """`[router.segments.NAME]`: one isolated router of the bus."""

    listen: tuple[str, ...] = ()
    """Endpoints for components; none means a free port of this machine."""
    connect: tuple[str, ...] = ()
    """Routers or peers outside that the segment joins."""
    config: dict[str, Any] = {}
    """Further Zenoh configuration: keys joined by `/`, and JSON values."""

    @field_validator("listen", "connect")
    @classmethod
    def _endpoints(cls, texts: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        try:
            return tuple(str(parse_endpoint(text, connect=info.field_name == "connect")) for text in texts)
        except ConfigError as error:
            raise mistake(error.message, hint=error.hint) from None

    @field_validator("config")
    @classmethod
    def _config(cls, config: dict[str, Any]) -> dict[str, Any]:
        for key, value in config.items():
            why = forbidden(key, value)
            if why is not None:
                raise mistake(f"{key!r} cannot be set here", hint=why, place=[key])
            try:
                json.dumps(value, allow_nan=False)
            except (TypeError, ValueError):
                hint = "write text, a finite number, true, false, a list or a table"
                raise mistake(f"Zenoh has no such value: {value!r}", hint=hint, place=[key]) from None
        return config

    @property
    def listeners(self) -> tuple[Endpoint, ...]:
        """`listen`, taken apart."""
        return tuple(parse_endpoint(text) for text in self.listen)

    @property
    def is_local(self) -> bool:
        """Whether only this machine reaches it: it listens on loopback or socket files, and joins nobody elsewhere."""
        scouting = any(
            key.startswith("scouting/multicast") and value is not False for key, value in self.config.items()
        )
        connected = (parse_endpoint(text, connect=True) for text in self.connect)
        return not scouting and all(each.is_local for each in (*self.listeners, *connected))


DEFAULT_SEGMENTS = {
    "system": SegmentSettings(listen=("tcp/127.0.0.1:7447",)),
    "unit": SegmentSettings(listen=("tcp/127.0.0.1:7448",)),
}


class RouterSettings(_Table):
    """`[router]`: name, segments, and what is done to the traffic between them."""

    name: Annotated[str, Field(pattern=f"^{SEGMENT_NAME}$")] = "router"
    """The router answers under `@riot/<name>/**`."""
    intercept: tuple[_Text, ...] = ()
    services: tuple[_Text, ...] = ()
    """Services and actions whose requests and replies are intercepted; names or key expressions."""
    record: _Text | None = None
    budget: Annotated[float, Field(gt=0, le=86_400)] = 1.0
    """Seconds that an interceptor may block."""
    control: tuple[SegmentName, ...] | None = None
    """Segments whose components may control the router; None means those that only this machine reaches."""
    segments: dict[SegmentName, SegmentSettings] = {}
    """Empty means `DEFAULT_SEGMENTS`."""
    interceptors: tuple[dict[str, Any], ...] = ()
    """Tables as they were written; who builds interceptors knows their keys."""

    @model_validator(mode="after")
    def _segments_stay_apart(self) -> Self:
        for (a, first), (b, second) in combinations(self.segments.items(), 2):
            for mine in first.listeners:
                for other in second.listeners:
                    if overlap(mine, other):
                        text = f"segments {a!r} and {b!r} both listen on {other}"
                        hint = "each segment needs a port of its own"
                        raise mistake(text, hint=hint, place=["segments", b, "listen"])
            for text in set(first.connect) & set(second.connect):
                raise mistake(
                    f"segments {a!r} and {b!r} both connect to {text}",
                    hint="what they have in common would pass there, around the interceptors",
                    place=["segments", b, "connect"],
                )
        for name, segment in self.segments.items():
            self._connects_outside(name, segment)
        for number, name in enumerate(self.control or ()):
            if self.segments and name not in self.segments:
                known = did_you_mean(name, self.segments)
                raise mistake(f"no segment {name!r}", hint=known, place=["control", str(number)])
        return self

    def _connects_outside(self, name: str, segment: SegmentSettings) -> None:
        for text in segment.connect:
            outside = parse_endpoint(text)
            for other, own in self.segments.items():
                if any(overlap(outside, listener) and outside.is_local for listener in own.listeners):
                    raise mistake(
                        f"segment {name!r} connects to {text}, which is segment {other!r} of this router",
                        hint="riot joins its segments itself",
                        place=["segments", name, "connect"],
                    )

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
    """Return the keys of a table at or below `[router]`; none where any key may stand.

    Args:
        place: Keys from `router` on.
    """
    if len(place) == 1:
        return list(RouterSettings.model_fields)
    if len(place) == 3 and place[1] == "segments":
        return list(SegmentSettings.model_fields)
    return []


def load_router(path: Path) -> RouterSettings:
    """Read `[router]` of a riot.toml; other tables may be missing and are not looked at.

    Paths come back absolute, Zenoh keys and values are checked. Without the table everything has its default.

    Raises:
        ConfigError: Missing file, unknown key or bad value; with place and suggestion.
    """
    document, text = read_toml(path)
    root = path.resolve().parent
    try:
        settings = RouterSettings.model_validate(document.get("router", {}))
    except ValidationError as error:
        raise explained(error, path, text, router_keys, prefix=["router"]) from None
    segments = {
        name: with_files(segment, root, path=path, text=text, name=name) for name, segment in settings.segments.items()
    }
    record = None if settings.record is None else str(root / settings.record)
    return settings.model_copy(update={"segments": segments, "record": record})
