import sys

import pytest

from riot_bus.generalize.validate import proportion
from riot_bus.vocabulary.errors import MissingExtraError


def test_a_proportion_of_nothing_says_nothing() -> None:
    nothing = proportion(0, 0)
    assert (nothing.rate, nothing.low, nothing.high) == (1.0, 0.0, 1.0)


def test_the_interval_holds_the_rate_and_widens_with_confidence() -> None:
    usual, surer = proportion(27, 30), proportion(27, 30, confidence=0.99)
    assert usual.rate == 0.9
    assert surer.low < usual.low < 0.9 < usual.high < surer.high


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.stats", None)
    with pytest.raises(MissingExtraError, match="scipy"):
        proportion(1, 2)
