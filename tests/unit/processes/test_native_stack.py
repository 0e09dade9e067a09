"""Native stacks of threads whose state is no good; good ones are in `test_tracing`."""

from __future__ import annotations

import os
import struct

import pytest

from riot_bus.processes.native_stack import AARCH64, X86_64, Machine, unwind


@pytest.mark.parametrize("machine", [X86_64, AARCH64])
@pytest.mark.parametrize("value", [0, 8, (1 << 64) - 1, 0x5555_5555_5555_5555])
def test_registers_that_point_nowhere_end_the_stack(machine: Machine, value: int) -> None:
    assert unwind(os.getpid(), struct.pack("<34Q", *[value] * 34), machine) in ([], [("[vsyscall]", "")])


def test_registers_are_known_by_dwarf_numbers() -> None:
    for machine in (X86_64, AARCH64):
        assert {machine.pc, machine.sp} <= set(machine.order)
        assert {machine.pc, machine.sp} <= set(machine.saved[1])


def test_a_process_that_is_gone_is_an_error() -> None:
    with pytest.raises(OSError, match="No such"):
        unwind(1 << 30, bytes(34 * 8), X86_64)
