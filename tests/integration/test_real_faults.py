"""The quickest cases of the judge: what program and twin do, and riot on the truth in place of the program."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.real_faults.__main__ import check
from benchmarks.real_faults.case import Case
from benchmarks.real_faults.run import run_case
from tests.interop import QUICK, of_case, require

pytestmark = [pytest.mark.integration, pytest.mark.parametrize("folder", QUICK, ids=lambda folder: folder.name)]


def test_program_and_twin_do_what_the_truth_says(folder: Path) -> None:
    for twin in (False, True):
        require(of_case(folder, twin=twin))
    assert check(Case(folder), draws=20, seed=0) == []


def test_riot_on_the_truth_is_graded(folder: Path, tmp_path: Path) -> None:
    result = run_case(Case(folder), tmp_path, seconds=0, seed=0, as_function=True, points=100)
    assert result.error == ""
    assert result.grade is not None
    assert result.grade.findings
    assert all(each.sort in ("known", "own") for each in result.grade.findings)
