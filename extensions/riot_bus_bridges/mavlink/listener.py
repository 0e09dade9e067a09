"""Drafts of riot.toml from what MAVLink links say: `riot init --mavlink`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.types.capabilities import HeardSystem
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_bridges.mavlink.sketch import sketch, sketch_json, sketch_lines, sketch_toml
from riot_bus_bridges.mavlink.survey import listen

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus_mavlink.adapter import MavlinkAdapter


class MavlinkListener:
    """Listens to MAVLink links; see `riot_bus.types.capabilities.ListensToLinks`."""

    def __init__(self, adapter: MavlinkAdapter) -> None:
        self._adapter = adapter

    def listen(
        self, links: Sequence[str], *, seconds: float, unit: str | None, warn: Callable[[str], None]
    ) -> HeardSystem:
        """Listen to MAVLink links for some seconds; `unit` is the id of a system."""
        if unit is not None and not (unit.isascii() and unit.isdigit()):
            raise ConfigError(f"{unit!r} is not the id of a system", where="--unit", hint="a number from 1 to 255")
        survey, specs = listen(links, self._adapter.dialect, seconds=seconds, warn=warn)
        found = sketch(survey, specs, self._adapter.dialect, seconds=seconds, unit=None if unit is None else int(unit))
        origin = f"what came over {', '.join(links)} within {seconds:g} s"
        return HeardSystem(sketch_toml(found, origin=origin), sketch_json(found), sketch_lines(found))
