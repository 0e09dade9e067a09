"""Memory of a long-running process: what is freed returns to the system; what stays is not searched for garbage."""

from __future__ import annotations

import ctypes
import gc
import os
from functools import cache
from typing import Any

_LARGEST_KEPT = 1 << 25  # glibc accepts no mmap threshold above 32 MiB
_OWN_WISHES = ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_", "GLIBC_TUNABLES")


def steady_heap() -> None:
    """Let glibc always return freed large blocks to the system; does nothing without glibc.

    It does so at first, but each large block that is freed raises the size from which it does so, up to 32 MiB. From
    then on such blocks lie among small ones in up to eight heaps per core, none of which ever shrinks.

    Settings in glibc's own environment variables are kept.
    """
    _set_thresholds(1 << 17, 1 << 17)  # what glibc begins with


def roomy_heap() -> None:
    """Let glibc keep freed large blocks: getting each one anew costs as much as compressing its content.

    For a process that handles one large payload after the other, and little else.
    """
    _set_thresholds(_LARGEST_KEPT, _LARGEST_KEPT * 8)


def calm_collector() -> None:
    """Let Python search for garbage rarely, and not among present objects; call it when all is loaded.

    Messages that wait to be recorded and new keys look like a growing program to the collector: it would search
    everything again and again, a fifth of a busy router's time, and meanwhile no message passes.
    """
    gc.enable()  # the command line loads without it
    gc.freeze()
    # 70 times the 700 of Python 3.11; garbage in cycles waits as much longer
    gc.set_threshold(50_000, *gc.get_threshold()[1:])


def trim_heap() -> None:
    """Give freed memory that the C library keeps back to the system; does nothing without glibc.

    Zenoh's threads allocate in up to eight heaps per core. In each, glibc keeps what lies below anything that is still
    in use: more than half of them, in a router with many short-lived keys.
    """
    trim = _malloc_trim()
    if trim is not None:
        trim(0)


def _set_thresholds(mmap: int, trim: int) -> None:
    set_ = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_ is not None and not any(name in os.environ for name in _OWN_WISHES):
        set_(-3, mmap)  # M_MMAP_THRESHOLD
        set_(-1, trim)  # M_TRIM_THRESHOLD


@cache
def _malloc_trim() -> Any:
    return getattr(ctypes.CDLL(None), "malloc_trim", None)
