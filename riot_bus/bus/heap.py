"""Freed memory is given back to the system."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

__all__ = ["trim_heap"]


def trim_heap() -> None:
    """Give back what the C library keeps of freed memory; does nothing where it is not glibc.

    Zenoh's threads allocate in up to eight heaps per core. Of each, glibc keeps what lies below anything that is still
    in use: more than half of them, in a router with many short-lived keys.
    """
    trim = _malloc_trim()
    if trim is not None:
        trim(0)


@cache
def _malloc_trim() -> Any:
    return getattr(ctypes.CDLL(None), "malloc_trim", None)
