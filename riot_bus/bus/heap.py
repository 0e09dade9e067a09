"""The memory of the C library, in which Zenoh's threads allocate: what they free goes back to the system."""

from __future__ import annotations

import ctypes
import os
from functools import cache
from typing import Any

__all__ = ["steady_heap", "trim_heap"]

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # as mallopt numbers them
_BYTES = 1 << 17  # what glibc begins with
_OWN_WISHES = ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_", "GLIBC_TUNABLES")


def steady_heap() -> None:
    """Let glibc give back large blocks that are freed, always; does nothing where it is not glibc.

    It begins with that, but each large block that is freed raises the size from which it does so, up to 32 MiB. From
    then on such blocks lie among small ones in up to eight heaps per core, each of which stays as large as it ever was.

    Whoever sets glibc's own variables keeps what they say.
    """
    set_ = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_ is not None and not any(name in os.environ for name in _OWN_WISHES):
        set_(_MMAP_THRESHOLD, _BYTES)
        set_(_TRIM_THRESHOLD, _BYTES)


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
