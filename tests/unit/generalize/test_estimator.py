"""The learner as an estimator of scikit-learn."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riot_bus.generalize.estimator import RuleClassifier
from riot_bus.vocabulary.errors import MissingExtraError

PAGE = Path(__file__).parents[3] / "docs/findings.md"


def table(count: int = 100) -> tuple[Any, Any]:
    chance = np.random.default_rng(1)
    x = chance.uniform(-100, 100, (count, 2))
    return x, (x[:, 0] * x[:, 1] < 0)


def test_a_rule_is_learnt_and_its_distance_is_its_decision() -> None:
    x, y = table()
    model = RuleClassifier().fit(x, np.where(y, "fails", "passes")[::1])
    assert model.classes_.tolist() == ["fails", "passes"]
    assert model.rule_.text() == "x0 * x1 > 0"
    model = RuleClassifier().fit(x, y)
    assert model.rule_.text() == "x0 * x1 < 0"
    decided = model.decision_function(x)
    assert ((decided > 0) == model.predict(x)).all()
    assert (decided != 0).all()
    assert model.score(x, y) == 1


def test_integers_stay_exact_and_names_of_columns_are_kept() -> None:
    pandas = pytest.importorskip("pandas")
    n = np.arange(2**60, 2**60 + 40)
    frame = pandas.DataFrame({"n": n, "other": n[::-1] % 7})
    model = RuleClassifier().fit(frame, n > 2**60 + 20)
    assert model.rule_.variables == ("n",)
    assert model.score(frame, n > 2**60 + 20) == 1


def test_arguments_are_set_by_name() -> None:
    assert repr(RuleClassifier().set_params(most_samples=10)) == "RuleClassifier(most_samples=10)"
    with pytest.raises(ValueError, match="most_samples"):
        RuleClassifier().set_params(depth=3)


def test_without_scikit_learn_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn.base", None)
    monkeypatch.delitem(sys.modules, "riot_bus.generalize.estimator")
    with pytest.raises(MissingExtraError, match="analysis"):
        importlib.import_module("riot_bus.generalize.estimator")


def test_the_example_of_the_docs(capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = [
        each for each in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL) if "RuleClassifier" in each
    ]
    exec(example, {})
    assert capsys.readouterr().out.strip() in PAGE.read_text()


@pytest.mark.nightly
def test_scikit_learn_finds_nothing_wrong() -> None:
    from sklearn.utils.estimator_checks import check_estimator

    check_estimator(RuleClassifier(), on_skip=None)
