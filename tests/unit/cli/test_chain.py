"""What bounds a campaign that is asked for on the command line, and what a demo that has found nothing says."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from typer.testing import CliRunner

from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps import robustness
from riot_bus.cli import chain
from riot_bus.cli.main import make_app
from riot_bus.findings.records import CampaignRecord
from tests.unit.chain.machine import SYSTEM

if TYPE_CHECKING:
    from collections.abc import Iterator


class StoppedError(Exception):
    """Ends a command as soon as it is known what it asks for."""


class Place:
    """A workspace with one unit, without anything external."""

    context = SimpleNamespace(
        file=SimpleNamespace(external=SimpleNamespace(topics=()), choose_unit=lambda name: name or "unit")
    )


@pytest.mark.parametrize(
    ("words", "trials"),
    [
        ("test", 100),
        ("test --covered", None),
        ("test --seconds 60", None),
        ("test --covered --trials 7", 7),
        ("test --seconds 60 --trials 7", 7),
        ("analyze", 100),
        ("analyze --seconds 60", None),
        ("analyze --trials 7", 7),
    ],
)
def test_trials_are_bounded_where_nothing_else_ends_a_campaign(
    words: str, trials: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int | None] = []

    @contextmanager
    def opened(*_: object, **__: object) -> Iterator[Place]:
        yield Place()

    def test_unit(*_: object, trials: int | None, **__: Any) -> None:
        asked.append(trials)
        raise StoppedError

    monkeypatch.setattr(chain, "open_workspace", opened)
    monkeypatch.setattr(robustness, "test_unit", test_unit)
    monkeypatch.setattr(robustness, "tested", lambda *_: None)
    result = CliRunner().invoke(make_app(words.split()[0]), words.split())
    assert isinstance(result.exception, StoppedError)
    assert asked == [trials]


@pytest.mark.parametrize(("notes", "code"), [({}, 0), ({"Rate state: no message came": 64}, 5)])
def test_a_demo_that_has_found_nothing_says_whether_that_means_something(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, notes: dict[str, int], code: int
) -> None:
    def demo(workspace: Workspace, *, trials: int) -> dict[str, object]:
        workspace.out.mkdir(exist_ok=True)
        CampaignRecord(unit="drive", fingerprint="f", tested=64, notes=notes).save(workspace.out)
        return {"findings": [], "seed": 0}

    monkeypatch.setattr("riot_bus.chain.steps.demo.demo", demo)
    (tmp_path / "riot.toml").write_text(SYSTEM)
    words = ["demo", "--system", str(tmp_path / "riot.toml"), "--out", str(tmp_path / "out")]
    told = CliRunner().invoke(make_app("demo"), words)
    line = "inconclusive: Rate state: no message came\n" if notes else "no finding\n"
    assert (told.exit_code, told.stdout) == (code, line), told.exception
