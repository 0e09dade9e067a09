"""How much of a corpus or a load is tried: a part of it in the gate, all of it by `bootstrap.py test --all`."""

from __future__ import annotations

import functools
import os
import zlib
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable
from typing import Any, TypeVar

import pytest

__all__ = ["ALL", "chosen", "folded", "scaled"]

CaseT = TypeVar("CaseT")
TestT = TypeVar("TestT", bound=Callable[..., None])

ALL = bool(os.environ.get("RIOT_ALL_TESTS"))
"""Whether everything is wanted; `bootstrap.py test --all` sets RIOT_ALL_TESTS."""


def scaled(full: int, *, gate: int | None = None) -> int:
    """Return a number of cases, examples or messages: all, or in the gate a quarter (or what `gate` says)."""
    if ALL:
        return full
    return gate if gate is not None else -(-full // 4)


def chosen(cases: Iterable[str], *, gate: Collection[str]) -> list[Any]:
    """Return parameters of a test: the gate takes the named cases only, `--all` takes every one."""
    cases = list(cases)
    assert set(gate) <= set(cases), f"there is no {set(gate) - set(cases)}"
    return [case if case in gate else pytest.param(case, marks=pytest.mark.nightly) for case in cases]


def folded(
    argument: str, cases: Iterable[CaseT], *, by: Callable[[CaseT], str], name: Callable[[CaseT], str] = str
) -> Callable[[TestT], TestT]:
    """Run a test with each of many cases, an item for each group of them; what fails names its case.

    The gate takes a quarter of the cases, always the same ones: their names' checksums decide.

    Args:
        argument: Of the test, which takes a case.
        cases: All of them.
        by: Returns the group of a case, which is the item's id.
        name: Returns the name of a case, which should not change.
    """
    groups: defaultdict[str, list[CaseT]] = defaultdict(list)
    for case in cases:
        if ALL or zlib.crc32(name(case).encode()) % 4 == 0:
            groups[by(case)].append(case)

    def decorate(test: TestT) -> TestT:
        @functools.wraps(test)
        def run(**arguments: object) -> None:
            for case in groups[arguments.pop(argument)]:
                try:
                    test(**arguments, **{argument: case})
                except BaseException as error:
                    error.add_note(f"{argument}: {name(case)}")
                    raise

        return pytest.mark.parametrize(argument, list(groups))(run)

    return decorate
