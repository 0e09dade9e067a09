"""Finds plug-ins by entry points: interceptors, codecs, monitors, steps; built-in ones in the same way as others.

A plug-in is imported when it is named; docs/extending.md lists what is imported although nothing names it. Other
packages cannot override the names of built-in plug-ins.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.vocabulary.errors import ConfigError, RiotError, did_you_mean

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

_DISTRIBUTION = "riot-bus"


class PluginKind(NamedTuple):
    """One kind of plug-in.

    Attributes:
        noun: Name of the kind in errors, such as "codec".
        group: Its group of entry points, such as "riot_bus.types".
    """

    noun: str
    group: str

    def targets(self) -> dict[str, str]:
        """Return all plug-ins of this kind: `module:attribute` (or `module`) by name, sorted by name."""
        every, own = ({point.name: point.value for point in points.select(group=self.group)} for points in _installed())
        return dict(sorted((every | (own or _declared().get(self.group, {}))).items()))

    def load(self, name: str, *, where: str | None = None) -> Any:
        """Import a plug-in and return what its entry point names: a class, function, value or module.

        Args:
            name: Name of the entry point.
            where: Place of the text that names it, for errors.

        Raises:
            ConfigError: No installed plug-in has this name, or it cannot be imported.
            RiotError: The import raised it, for example `MissingExtraError`.
        """
        targets = self.targets()
        if name not in targets:
            hint = did_you_mean(name, targets) or f"known: {', '.join(targets) or 'none'}"
            raise ConfigError(f"unknown {self.noun} {name!r}", where=where, hint=hint)
        module, _, attribute = targets[name].partition(":")
        try:
            found = import_module(module)
            return getattr(found, attribute) if attribute else found
        except RiotError:
            raise
        except Exception as error:  # a third-party package may raise anything
            hint = "mend or uninstall the package"
            text = f"{self.noun} {name!r} cannot be loaded: {error}"
            raise ConfigError(text, where=targets[name], hint=hint) from error


ADAPTERS = PluginKind("adapter", "riot_bus.adapters")
CODECS = PluginKind("codec", "riot_bus.types")
COMMANDS = PluginKind("command", "riot_bus.commands")
DICTIONARIES = PluginKind("dictionary", "riot_bus.dictionaries")
FAULTS = PluginKind("fault kind", "riot_bus.faults")
HOOKS = PluginKind("extension hook", "riot_bus.hooks")
INTERCEPTORS = PluginKind("interceptor", "riot_bus.interceptors")
LISTENERS = PluginKind("adapter that listens to links", "riot_bus.listeners")
MONITORS = PluginKind("monitor", "riot_bus.monitors")
REPORTS = PluginKind("report format", "riot_bus.reports")
RULE_FORMS = PluginKind("form of a rule", "riot_bus.rule_forms")
SEARCHES = PluginKind("search method", "riot_bus.search")
STEPS = PluginKind("step", "riot_bus.steps")


def hook(name: str, extension: str) -> Any:
    """Return what an extension offers to riot itself, such as the workers of a cluster: see `riot_bus.plugin`.

    Args:
        name: Name of the hook, an entry point of the group `riot_bus.hooks`.
        extension: Package of riot that has it, for errors.

    Raises:
        ConfigError: The extension is not installed, or cannot be imported.
    """
    if name not in HOOKS.targets():
        raise ConfigError(f"this needs {extension}", hint=f"install {extension}: it is an extension of riot")
    return HOOKS.load(name)


@cache
def _installed() -> tuple[Any, EntryPoints]:
    """Return the entry points of all packages, and our own.

    Read once, since each call of `entry_points` reads files of every package. The names of distributions are not read,
    since that would parse all of their metadata.
    """
    from importlib.metadata import EntryPoints, PackageNotFoundError, distribution, entry_points  # slow to load

    try:
        own = distribution(_DISTRIBUTION).entry_points
    except PackageNotFoundError:
        own = EntryPoints()
    return entry_points(), own


@cache
def _declared() -> dict[str, dict[str, str]]:
    """Return our own plug-ins as pyproject.toml declares them, for a checkout that is used without being installed."""
    import tomllib

    file = Path(__file__).resolve().parents[1] / "pyproject.toml"
    try:
        found: dict[str, dict[str, str]] = tomllib.loads(file.read_text(encoding="utf-8"))["project"]["entry-points"]
    except (OSError, KeyError, tomllib.TOMLDecodeError):
        return {}
    return found
