"""Construction of the monitors that `[[monitors]]` in riot.toml names, from entry points or a file."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, cast

from riot_bus.pipeline.loader import load_class
from riot_bus.plugin_options import check_known, instance_of, options_of
from riot_bus.plugins import MONITORS
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from riot_bus.monitors.model import Invariant


def build_monitor(table: Mapping[str, Any], *, where: Callable[[str], str], root: Path) -> Invariant:
    """Build the monitor of a `[[monitors]]` table; if it names a file, its code is executed.

    Args:
        table: Table as it was written; `kind` is a name, or `FILE.py[:NAME]`.
        where: Function that returns the location of a key of the table, for errors; of the table for an empty key.

    Raises:
        ConfigError: There is no such monitor, or an option is unknown, missing or wrong.
    """
    own = dict(table)
    name = own.pop("kind", None)
    if not isinstance(name, str):
        raise ConfigError("which monitor?", where=where("kind"), hint=f"kind is one of {', '.join(MONITORS.targets())}")
    is_file = name.partition(":")[0].endswith(".py")
    kind: Any = load_class(str(root / name), method="judge") if is_file else MONITORS.load(name, where=where("kind"))
    if not inspect.isclass(kind):
        raise ConfigError(f"monitor {name!r} is not a class", where=MONITORS.targets()[name])
    check_known(own, options_of(kind), where)
    return cast("Invariant", instance_of(kind, own, where, root=root))
