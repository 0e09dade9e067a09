"""The demo does what is left to do, and tells the figures of the finding that has got farthest."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.chain.steps import demo as module
from riot_bus.chain.steps.analyze import Analysis


def view(name: str, steps: int, *, found: object = None, occurrences: int = 1) -> Any:
    """Return the view of a finding of which so many of five steps have finished."""
    region = SimpleNamespace(ranges=[SimpleNamespace(field="goal.x", low=-1.0, high=2.0)])
    activation = SimpleNamespace(found=found, runs=9, replay_rate=0.5, region=region if found else None)
    records = [SimpleNamespace(trials=10 * n) if n < steps else None for n in range(5)]
    return SimpleNamespace(
        steps=[(SimpleNamespace(name=f"step{n}"), record) for n, record in enumerate(records)],
        finding=SimpleNamespace(seed=3, occurrences=occurrences, name=name),
        minimal=SimpleNamespace(kept=(1, 2)) if steps > 1 else None,
        fields=SimpleNamespace(fields=[SimpleNamespace(name="x")]) if steps > 2 else None,
        rule=SimpleNamespace(text="x > 1", balanced_accuracy=1.0) if steps > 3 else None,
        permeability=SimpleNamespace(permeable=("goal.x",)) if steps > 3 else None,
        activation=activation if steps > 4 else None,
    )


class Chain:
    """A workspace, and the doubles of the steps."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, views: dict[str, Any], earlier: list[Path] | None) -> None:
        self.called: list[str] = []
        self.ended: list[str] = []
        self.seed = 5
        unit, system = SimpleNamespace(name="nav"), SimpleNamespace(name="rover")
        self.context = SimpleNamespace(file=SimpleNamespace(system=system, choose_unit=lambda _: unit))
        folders = [Path(name) for name in views]

        def run(workspace: object, unit: object, *, trials: int, seconds: None, covered: bool) -> list[Path]:
            self.called.append(f"{trials} trials")
            return folders

        monkeypatch.setattr(module, "log_info", lambda log: SimpleNamespace(count=1))
        monkeypatch.setattr(module, "tested", lambda workspace, unit: earlier)
        monkeypatch.setattr(module, "test_unit", run)
        monkeypatch.setattr(
            module,
            "analyze_all",
            lambda workspace, folders: [Analysis(each, each / "report.html") for each in folders],
        )
        monkeypatch.setattr(module.view, "load", lambda folder: views[str(folder)])

    @contextmanager
    def step(self, name: str) -> Any:
        self.called.append(name)
        yield SimpleNamespace(end=self.ended.append)

    def nominal_log(self) -> Path:
        return Path("nominal.mcap")


def figures(monkeypatch: pytest.MonkeyPatch, views: dict[str, Any], earlier: list[Path] | None = None) -> Any:
    chain: Any = Chain(monkeypatch, views, earlier)
    return chain, module.demo(chain, trials=40)


def test_without_findings_only_the_nominal_run_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    chain, found = figures(monkeypatch, {})
    assert chain.ended == ["nominal run of rover: 1 message"]
    assert chain.called == ["record", "40 trials"]
    assert found.pop("seconds") >= 0
    assert found == {"seed": 5, "nominal_messages": 1, "findings": []}


def test_a_unit_that_was_tested_is_not_tested_again(monkeypatch: pytest.MonkeyPatch) -> None:
    chain, found = figures(monkeypatch, {"a": view("a", 1)}, [Path("a")])
    assert chain.called == ["record"]
    assert found["findings"] == ["a"]
    assert found["minimal_messages"] is None
    assert found["trials"] == {"step0": 0}


def test_figures_are_those_of_the_finding_that_got_farthest(monkeypatch: pytest.MonkeyPatch) -> None:
    views = {
        "rare": view("rare", 5, found=None, occurrences=9),
        "best": view("best", 5, found={"goal.x": 1.0}),
        "often": view("often", 2, occurrences=99),
    }
    _, found = figures(monkeypatch, views)
    assert found["finding"] == "best"
    assert (found["minimal_messages"], found["relevant_fields"], found["rule"]) == (2, ["x"], "x > 1")
    assert found["region"] == {"goal.x": (-1.0, 2.0)}
    assert found["trials"] == {f"step{n}": 10 * n for n in range(5)}
    assert (found["report"], found["stopped"], found["seed"]) == ("best/report.html", None, 3)


def test_among_equals_the_more_frequent_one_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    _, found = figures(monkeypatch, {"a": view("a", 3), "b": view("b", 3, occurrences=2)})
    assert found["finding"] == "b"
