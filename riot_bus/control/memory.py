"""How much memory this process uses, and how much it may: a router that grows without end shuts down in order."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from riot_bus.config.arguments import parse_size
from riot_bus.control.signals import force_end_after
from riot_bus.vocabulary.errors import EnvironmentFaultError

_VARIABLE = "RIOT_MEMORY_LIMIT"
_STATM = Path("/proc/self/statm")
_GROUP = Path("/sys/fs/cgroup/memory.max")
_PAGE = os.sysconf("SC_PAGE_SIZE")


def memory_limit() -> int:
    """Return how many bytes this process may use: RIOT_MEMORY_LIMIT, else three quarters of what there is.

    Raises:
        ConfigError: The variable is not a size.
    """
    written = os.environ.get(_VARIABLE)
    if written:
        return parse_size(written, _VARIABLE)
    present = os.sysconf("SC_PHYS_PAGES") * _PAGE
    try:
        group = _GROUP.read_text(encoding="ascii").strip()
    except OSError:  # no control groups, or those of version 1
        group = "max"
    # the rest is for the kernel's buffers and an orderly end
    return (min(present, int(group)) if group.isdecimal() else present) * 3 // 4


def resident_bytes() -> int:
    """Return how many bytes of memory this process uses now; 0 where the system does not say."""
    try:
        return int(_STATM.read_text(encoding="ascii").split()[1]) * _PAGE
    except OSError:
        return 0


def check_memory(limit: int) -> None:
    """Raise if this process uses more than it may; then its end is forced if it takes too long.

    Raises:
        EnvironmentFaultError: It uses more.
    """
    used = resident_bytes()
    if used > limit:
        force_end_after(5.0)  # Zenoh may still be growing, and not answer
        error = EnvironmentFaultError(
            f"this process uses {used >> 20} MiB of memory, more than {limit >> 20} MiB",
            hint="a client may have subscribed to a key with many wildcards, which costs Zenoh memory "
            f"(docs/router.md); {_VARIABLE} sets another limit, such as 8GiB",
        )
        sys.stderr.write(f"riot: {error}\n")  # now, since the end may have to be forced
        sys.stderr.flush()
        raise error
