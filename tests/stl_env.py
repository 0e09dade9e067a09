"""The package rtamt for tests of formulas: it is pure Python, and found in an environment of its own."""

from __future__ import annotations

import sys
import warnings

import pytest

from tests.interop import RTAMT, importable


def need_rtamt() -> None:
    """Make rtamt importable; without it the test is skipped, or fails if told so."""
    if sys.version_info >= (3, 13):
        pytest.skip("NOT TESTED: monitor stl: rtamt has no release for Python 3.13")
    importable(RTAMT, "rtamt")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its parser imports typing.io
        import rtamt  # noqa: F401
