"""What is said of a test whose messages never end; the rest needs a bus: tests/integration."""

from __future__ import annotations

import warnings
from contextlib import ExitStack, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.router.counts import TopicCounts
from riot_bus.testing import fixture
from riot_bus.testing.fixture import RouterTest


def problems(monkeypatch: pytest.MonkeyPatch, *, through: bool) -> list[str]:
    """Return those of a test after which a message is not accounted for."""
    counts = [{}, {"a": TopicCounts(received=2, forwarded=1)}]
    bus: Any = SimpleNamespace(
        counts=lambda: counts.pop(0),
        flows=dict,
        drain=lambda _: through,
        losses=SimpleNamespace(reasons={}),
        executor=SimpleNamespace(pipeline=SimpleNamespace(errors={})),
    )
    router: Any = SimpleNamespace(bus=bus, pass_all=lambda: None)
    capture: Any = None
    monkeypatch.setattr(fixture, "Receivers", nullcontext)
    with ExitStack() as stack:
        return RouterTest(router, capture, stack, folder=Path(), out=Path(), seed=0).problems()


def test_counts_that_are_not_checked_are_no_silent_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.warns(
        UserWarning, match="counts are not checked, since messages are still on their way 5 s after the test"
    ):
        assert problems(monkeypatch, through=False) == []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (told,) = problems(monkeypatch, through=True)
    assert "do not balance: 2 came, 1 are accounted for" in told
