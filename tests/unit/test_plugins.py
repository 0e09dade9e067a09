"""Plug-ins of every kind are found by entry points, the built-in ones in no other way than those of others."""

from __future__ import annotations

import importlib.metadata
import shutil
import sys
import tomllib
from importlib import import_module
from importlib.metadata import EntryPoint, distribution
from pathlib import Path

import pytest
from typer.testing import CliRunner

from riot_bus import plugins
from riot_bus.cli.main import make_app
from riot_bus.log.writer import LogWriter
from riot_bus.plugins import CODECS, MONITORS
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError
from riot_bus.vocabulary.message import Message
from riot_bus_bridges.cli.bridge import BRIDGES
from riot_bus_testkit.reports import campaign_at
from tests.plugin_kinds import KINDS

DECLARED = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]["entry-points"]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.group)
def test_each_kind_has_built_in_ones_which_can_all_be_loaded(kind) -> None:
    assert kind.targets().keys() >= DECLARED[kind.group].keys()
    for name in DECLARED[kind.group]:
        assert kind.load(name) is not None


def test_every_declared_group_is_a_kind() -> None:
    assert {group for group in DECLARED if group.startswith("riot_bus.")} == {kind.group for kind in (*KINDS, BRIDGES)}


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


FOREIGN = """
with open({mark!r}, "a") as stream:
    stream.write("{group} ")
class Foreign:
    name = "foreign"
    def topic(self, key): return None
    def key_expression(self, topic): return None
    def type_named(self, name): return None
    def type_of_schema(self, schema): return None
    def load(self, files): pass
"""


@pytest.mark.parametrize(
    ("words", "loaded"),
    [
        ("findings .", ""),
        ("findings . --format=json", ""),
        ("report . --format=sarif", ""),
        ("report findings/planner-crash-1f3a --format=text", ""),
        ("report findings/planner-crash-1f3a --format=html", ""),
        ("compare . .", ""),
        ("info a.mcap", ""),
        ("info a.mcap --fields", "adapters"),
        ("types a.mcap", "adapters"),
        ("show a.mcap", "adapters"),
        ("diff a.mcap a.mcap", "adapters"),
        ("edit a.mcap b.mcap --keep k", ""),
        ("show named.mcap", "adapters types"),
        ("report named --format=text", "steps"),
        ("dict list", "dictionaries"),
        ("interceptors", "interceptors"),
    ],
)
def test_exactly_this_is_imported_though_no_user_names_it(
    words: str, loaded: str, tmp_path: Path, plugin_package, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = tmp_path / "imported"
    for kind in KINDS:
        plugin_package(FOREIGN.format(mark=str(mark), group=kind.group), kind.group, foreign="Foreign")
    campaign_at("finished", tmp_path)
    shutil.copytree(tmp_path / "findings" / "planner-crash-1f3a", tmp_path / "named")
    (tmp_path / "named" / "foreign.json").write_text("{}")  # a record of a finding names the step
    for name, encoding in (("a", "json"), ("named", "application/foreign")):  # an encoding in a log names the codec
        with LogWriter(tmp_path / f"{name}.mcap", registry=TypeRegistry()) as writer:
            writer.write(Message(1, "k", b"[1]", encoding=encoding))
    mark.unlink(missing_ok=True)
    for module in [name for name in sys.modules if name.startswith("package_of_others_")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(make_app(words.split()[0]), words.split())
    assert done.exit_code == 0 or loaded == "dictionaries", done.output  # a class is no folder of dictionaries
    found = mark.read_text().split() if mark.exists() else []
    assert sorted(found) == [f"riot_bus.{each}" for each in loaded.split()]


def test_the_page_lists_what_is_imported() -> None:
    page = " ".join((Path(__file__).parents[2] / "docs" / "extending.md").read_text().split())
    assert "imported only when it is named, but for [adapters](adapters.md#how-adapters-are-found), wherever" in page
    assert "dictionaries, wherever values are chosen; codecs, in `riot init`" in page


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
