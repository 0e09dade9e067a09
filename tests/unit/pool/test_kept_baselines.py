from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.monitors.mined import Mined, MinedRule
from riot_bus.pool.kept_baselines import KeptBaselines
from riot_bus.processes.activity import Idle
from riot_bus.trial.baseline import Baseline, Growth, probe_of
from riot_bus.trial.hangs import KnownHangs
from riot_bus.vocabulary.message import Message

LOG = tuple(Message(number, "cmd", bytes([number])) for number in range(40))
MEASURED = Baseline(
    Idle(9.5, 0.01),
    3,
    LOG,
    probe_of(LOG),
    {"state": 40},
    {"state": 16},
    {"wait": 1},
    {"main": 1},
    main_ends=False,
    ends=False,
    growth=Growth(1 << 40, 2, 3),
    ordered=True,
    mined=Mined((MinedRule("value", "state", "x", (1.0, float("-inf")), (2.0, 3.0)),), 6, 0, 8, ("d",)),
    alarms=("exit of u: status 0",),
)


class Units:
    """Measures units, and counts how often."""

    def __init__(self, folder: Path, found: Baseline = MEASURED) -> None:
        self.folder, self.found, self.count = folder, found, 0

    def measure(self) -> Baseline:
        self.count += 1
        return self.found

    def get(
        self, fingerprint: str = "f", unit: str = "u", where: str = "alone", log: tuple[Message, ...] = LOG
    ) -> Baseline:
        return KeptBaselines(self.folder, fingerprint).get(unit, where, log, self.measure)

    @property
    def file(self) -> Path:
        (path,) = self.folder.iterdir()
        return path


def test_a_baseline_is_measured_once_and_is_the_same_afterwards(tmp_path: Path) -> None:
    units = Units(tmp_path / "baselines")
    assert [units.get(), units.get()] == [MEASURED, MEASURED]
    assert units.count == 1
    assert units.file.stat().st_size < 2000, "messages are not kept again"


@pytest.mark.parametrize("other", [{"fingerprint": "g"}, {"unit": "v"}, {"where": "in the system"}, {"log": LOG[:-1]}])
def test_one_of_other_code_another_unit_or_another_log_is_measured(tmp_path: Path, other: dict[str, str]) -> None:
    units = Units(tmp_path)
    units.get()
    units.get(**other)  # type: ignore[arg-type]
    assert units.count == 2


def test_a_file_of_another_unit_in_the_place_of_one_is_not_used(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    units, others = Units(tmp_path / "a"), Units(tmp_path / "b", replace(MEASURED, trials=9))
    units.get()
    others.get(unit="v")
    units.file.write_bytes(others.file.read_bytes())
    with caplog.at_level(logging.INFO):
        assert units.get() == MEASURED
    assert "of other code, settings or another nominal log" in caplog.text
    assert units.count == 2


@pytest.mark.parametrize(
    "wrong", [b"", b"\xc1", b"\x80", b"\x01", b"[1]", "cut", "changed", "list", bytes((16 << 20) + 1)]
)
def test_a_file_that_is_no_baseline_is_measured_anew_which_is_said(
    tmp_path: Path, wrong: bytes | str, caplog: pytest.LogCaptureFixture
) -> None:
    units = Units(tmp_path)
    units.get()
    good = units.file.read_bytes()
    if wrong == "cut":
        wrong = good[: len(good) // 2]
    elif wrong == "changed":
        wrong = good.replace(b"\xa6trials\x03", b"\xa6trials\xc0")
    elif wrong == "list":
        wrong = b"\x91" * 100_000
    assert isinstance(wrong, bytes)
    units.file.write_bytes(wrong)
    assert units.get() == MEASURED
    assert units.count == 2
    assert f"nominal trials are measured anew: {units.file} cannot be used" in caplog.text
    assert units.get() == MEASURED
    assert units.count == 2


def test_what_did_not_pass_is_measured_by_the_next_command_too(tmp_path: Path) -> None:
    units = Units(tmp_path, Baseline(mute=("3 of 3 trials did not pass",)))
    units.get(), units.get()
    assert units.count == 2
    assert list(tmp_path.iterdir()) == []


HANGS = KnownHangs(((), (("spin", "main"), ("wait", "work"))), 0.75)


def test_hangs_are_kept_beside_the_baseline_and_bound_to_the_same(tmp_path: Path) -> None:
    units, kept = Units(tmp_path / "baselines"), KeptBaselines(tmp_path / "baselines", "f")
    assert kept.hangs("u", LOG) == KnownHangs()
    units.get()
    kept.keep_hangs("u", LOG, HANGS)
    assert kept.hangs("u", LOG) == HANGS
    assert units.get() == MEASURED
    assert units.count == 1
    others = [
        kept.hangs("v", LOG),
        kept.hangs("u", LOG[:-1]),
        KeptBaselines(tmp_path / "baselines", "g").hangs("u", LOG),
    ]
    assert others == [KnownHangs()] * 3
    kept.keep_hangs("u", LOG, KnownHangs())
    assert kept.hangs("u", LOG) == KnownHangs()


@pytest.mark.parametrize("wrong", [b"", b"{}", b"\xff", b'["f", {"places": 1}]', b"[" * 100_000])
def test_a_file_that_holds_no_hangs_is_as_if_there_was_none(tmp_path: Path, wrong: bytes) -> None:
    kept = KeptBaselines(tmp_path, "f")
    kept.keep_hangs("u", LOG, HANGS)
    (path,) = tmp_path.iterdir()
    path.write_bytes(wrong)
    assert kept.hangs("u", LOG) == KnownHangs()
