"""Surroundings of trials that are the same each time, so that what differs is what was injected."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Mapping

from riot_bus.sut.supervisor import ADDR_NO_RANDOMIZE

__all__ = ["FIXED", "fixed_environment", "fixes_addresses"]

FIXED: Mapping[str, str] = {
    "LC_ALL": "C.UTF-8",
    "TZ": "UTC",
    "PYTHONHASHSEED": "0",
    "PYTHONUNBUFFERED": "1",  # what was printed last is there when a process is killed
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}
"""Variables of components in trials. One thread for numeric libraries, since sums in another order differ."""


def fixed_environment(given: Mapping[str, str]) -> dict[str, str]:
    """Return the fixed variables except those that the component's `env` in riot.toml sets itself."""
    return {name: value for name, value in FIXED.items() if name not in given}


@functools.cache
def fixes_addresses() -> bool:
    """Return whether the kernel lets processes have the same addresses each time; in some containers it does not."""
    personality = ctypes.CDLL(None).personality
    before = personality(0xFFFFFFFF)
    fixed = before != -1 and personality(before | ADDR_NO_RANDOMIZE) != -1
    if fixed:
        personality(before)
    return bool(fixed)
