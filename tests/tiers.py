"""How much is tried: the gate takes a part, another one for each commit; `bootstrap.py test --all` takes all."""

from __future__ import annotations

import functools
import os
import subprocess
import zlib
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import pytest

__all__ = ["ALL", "PART", "PARTS", "chosen", "folded", "in_part", "of_other_parts", "scaled"]

CaseT = TypeVar("CaseT")
TestT = TypeVar("TestT", bound=Callable[..., None])

ALL = bool(os.environ.get("RIOT_ALL_TESTS"))
"""Whether everything is wanted; `bootstrap.py test --all` sets RIOT_ALL_TESTS."""


def _of_commit() -> str:
    """Return a number that depends on the commit that is checked out; 0 outside of a repository."""
    words = ["git", "rev-parse", "--short=7", "HEAD"]
    done = subprocess.run(words, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    return str(int(done.stdout or "0", 16))


PARTS = 8
"""The part in the gate of the items that take long, or of a corpus, is 1 of so many."""

PART = int(os.environ.get("RIOT_PART") or _of_commit())
"""Which part is taken, modulo their number; in files that are named on the command line, only if it is set."""


def in_part(name: str, parts: int = PARTS) -> bool:
    """Return whether something of a constant name is tried: all, or in the gate what is of this commit's part."""
    return ALL or (zlib.crc32(name.encode()) + PART) % parts == 0


def of_other_parts(seconds: Mapping[str, float], part: int = PART) -> set[str]:
    """Return what is not in a part, of items that take some time; parts take about as long as each other."""
    lengths, others = [0.0] * PARTS, set[str]()
    for name in sorted(seconds, key=lambda name: (-seconds[name], name)):
        shortest = lengths.index(min(lengths))
        lengths[shortest] += seconds[name]
        if shortest != part % PARTS:
            others.add(name)
    return others


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

    The gate takes the cases of its part: their names' checksums decide.

    Args:
        argument: Of the test, which takes a case.
        cases: All of them.
        by: Returns the group of a case, which is the item's id.
        name: Returns the name of a case, which should not change.
    """
    groups: defaultdict[str, list[CaseT]] = defaultdict(list)
    for case in cases:
        groups[by(case)] += [case] if in_part(name(case)) else []

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
