"""Searches that share a study of optuna go on where others are; nobody has to be there at the same time."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from riot_bus.backchain.activation import Evaluation, activate
from riot_bus.backchain.encoding import SearchField
from riot_bus.backchain.varied import VariedInputs
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError
from riot_bus_cluster.study import Study
from tests.interop import OPTUNA, importable

FIELDS = (
    SearchField("x", 0.0, 1.0, -1000.0, 1000.0),
    SearchField("n", 3.0, 1.0, 0, 4_000_000_000, integer=True),
    SearchField("gear", 0.0, 0.5, 0, 2, integer=True, choice=True),
)
Point = dict[str, float]


def evaluated(points: Sequence[Point], *, limit: float) -> list[Evaluation]:
    return [
        Evaluation(limit - each["x"], each["x"] >= limit) if each["x"] > -10 else Evaluation(None, False)
        for each in points
    ]


def search(url: str, *, limit: float, seed: int, budget: int) -> tuple[list[Point], bool]:
    """Return the points that a search asked for, and whether it has found what fails."""
    asked: list[Point] = []

    def evaluate(points: Sequence[Point]) -> list[Evaluation]:
        asked.extend(points)
        return evaluated(points, limit=limit)

    found = activate(FIELDS, evaluate, seed=seed, budget=budget, shared=Study(url, "system finding 1"))
    return asked, found.found is not None


@pytest.fixture
def url(tmp_path: Path) -> str:
    importable(OPTUNA, "optuna")
    return f"sqlite:///{tmp_path / 'studies.db'}"


def test_a_search_asks_for_nothing_that_another_has_asked_for(url: str) -> None:
    first, found = search(url, limit=2000.0, seed=1, budget=25)
    assert (len(first), found) == (25, False)
    second, _ = search(url, limit=2000.0, seed=1, budget=25)
    assert not {tuple(point.items()) for point in first} & {tuple(point.items()) for point in second}
    import optuna

    (study,) = optuna.get_all_study_summaries(url)
    assert (study.study_name, study.n_trials) == ("system finding 1", 50)
    trials = optuna.load_study(study_name=study.study_name, storage=url).trials
    assert {trial.state.name for trial in trials} == {"COMPLETE", "FAIL"}
    assert {trial.value == 2000.0 - trial.params["x"] for trial in trials if trial.value is not None} == {True}


def test_what_failed_in_another_search_is_tried_first(url: str) -> None:
    asked, found = search(url, limit=150.0, seed=1, budget=200)
    assert found
    assert search(url, limit=150.0, seed=2, budget=200) == ([asked[-1]], True)


def test_inputs_that_vary_in_time_are_kept_too(url: str) -> None:
    varied = VariedInputs(FIELDS[:1], 6.0, [120])
    study, seen = Study(url, "varies"), []

    def evaluate(points: Sequence[Point]) -> list[Evaluation]:
        seen.extend(points)
        return [Evaluation(5.0, False) for _ in points]

    activate(FIELDS[:1], evaluate, seed=0, budget=60, families=varied.families, shared=study)
    assert [point for point, _ in Study(url, "varies").take()] == seen
    assert any("[part 1]" in name for point in seen for name in point)
    assert study.take() == []


@pytest.mark.parametrize("wrong", ["nothing", "postgres://localhost/x", "sqlite:////nowhere/at/all.db"])
def test_a_storage_that_cannot_be_used_is_told(url: str, wrong: str) -> None:
    with pytest.raises(ConfigError, match="--study: the storage of studies cannot be used"):
        Study(wrong, "name")


def test_without_optuna_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(MissingExtraError, match=r"'\.\[study\]'"):
        Study("sqlite:///x.db", "name")
