"""Plug-ins of every kind are found by entry points, the built-in ones in no other way than those of others."""

from __future__ import annotations

import importlib.metadata
import tomllib
from importlib import import_module
from importlib.metadata import EntryPoint, distribution
from pathlib import Path

import pytest

from riot_bus import plugins
from riot_bus.plugins import CODECS, KINDS, MONITORS
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError

DECLARED = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]["entry-points"]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.group)
def test_each_kind_has_built_in_ones_which_can_all_be_loaded(kind) -> None:
    assert kind.targets().keys() >= DECLARED[kind.group].keys()
    for name in DECLARED[kind.group]:
        assert kind.load(name) is not None


def test_every_declared_group_is_a_kind() -> None:
    assert {group for group in DECLARED if group.startswith("riot_bus.")} == {kind.group for kind in KINDS}


def test_one_of_others_is_found_beside_the_built_in_ones(plugin_package) -> None:
    module = plugin_package("class Mine:\n    pass\n", "riot_bus.monitors", mine="Mine")
    assert MONITORS.load("mine") is import_module(module).Mine
    assert "range" in MONITORS.targets()


def test_a_built_in_name_cannot_be_taken(plugin_package) -> None:
    plugin_package("class Mine:\n    pass\n", "riot_bus.monitors", range="Mine")
    assert MONITORS.targets()["range"] == DECLARED["riot_bus.monitors"]["range"]


def test_an_unknown_name_is_an_error_that_suggests_one() -> None:
    with pytest.raises(ConfigError) as caught:
        MONITORS.load("sequense", where="riot.toml:7")
    assert (caught.value.where, caught.value.hint) == ("riot.toml:7", "did you mean 'sequence'?")
    with pytest.raises(ConfigError) as caught:
        CODECS.load("zzzzzz")
    assert caught.value.hint is not None
    assert "cbor" in caught.value.hint


def test_a_package_that_is_broken_says_so_and_a_missing_extra_keeps_its_hint(plugin_package) -> None:
    plugin_package("raise OSError('no disk')\n", "riot_bus.monitors", broken="Mine")
    with pytest.raises(ConfigError, match="monitor 'broken' cannot be loaded: no disk"):
        MONITORS.load("broken")
    code = "from riot_bus.vocabulary.errors import MissingExtraError\nraise MissingExtraError('pkg', 'extra')\n"
    plugin_package(code, "riot_bus.monitors", lacking="Mine")
    with pytest.raises(MissingExtraError):
        MONITORS.load("lacking")


def test_nothing_is_imported_before_it_is_named(plugin_package) -> None:
    plugin_package("raise OSError('imported')\n", "riot_bus.types", mine="Mine")
    assert "mine" in CODECS.targets()
    assert CODECS.load("json") is not None


def test_a_checkout_that_is_not_installed_reads_its_own_declaration(monkeypatch: pytest.MonkeyPatch) -> None:
    def not_installed(name: str) -> object:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "entry_points", importlib.metadata.EntryPoints)
    monkeypatch.setattr(importlib.metadata, "distribution", not_installed)
    plugins._installed.cache_clear()
    try:
        assert MONITORS.targets() == DECLARED["riot_bus.monitors"]
    finally:
        monkeypatch.undo()
        plugins._installed.cache_clear()


def test_the_installed_distribution_declares_the_same() -> None:
    points: list[EntryPoint] = list(distribution("riot-bus").entry_points)
    found = {(point.group, point.name): point.value for point in points if point.group.startswith("riot_bus.")}
    assert found == {
        (group, name): value
        for group, names in DECLARED.items()
        for name, value in names.items()
        if group.startswith("riot_bus.")
    }
