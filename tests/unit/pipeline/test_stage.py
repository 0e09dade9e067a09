"""Stages say where in an interceptor's own file something went wrong."""

from __future__ import annotations

import sys
from collections import Counter

import pytest

from riot_bus.pipeline.stage import Stage


class Fails:
    def message(self, event: object) -> None:
        int("no number")


class Looks:
    def message(self, event: object) -> None:
        self.frame = sys._getframe()


def place(function: object) -> str:
    return f"{__file__}:{function.__code__.co_firstlineno + 1}"  # type: ignore[attr-defined]


def test_an_exception_is_placed_at_the_last_line_of_the_interceptors_own_file() -> None:
    stage = Stage(Fails(), Counter())
    with pytest.raises(ValueError, match="no number") as caught:
        stage.message(None)  # type: ignore[arg-type]
    assert stage.place(caught.value) == place(Fails.message)
    assert stage.place(ValueError("never raised")) == ""


def test_a_stack_is_placed_at_its_last_line_of_the_interceptors_own_file() -> None:
    looks = Looks()
    stage = Stage(looks, Counter())
    looks.message(None)
    assert stage.place_of_frame(looks.frame) == place(Looks.message)
    assert stage.place_of_frame(None) == ""


def test_an_interceptor_that_is_not_written_in_python_has_no_place() -> None:
    stage = Stage(type("Appends", (), {"message": [].append})(), Counter())
    assert stage.place_of_frame(sys._getframe()) == ""
