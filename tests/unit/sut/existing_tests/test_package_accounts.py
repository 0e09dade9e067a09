from __future__ import annotations

from pathlib import Path

from riot_bus.sut.existing_tests.package_accounts import leave_account, package_lines


def test_all_packages_are_told_and_what_has_shown_nothing_loudly(tmp_path: Path) -> None:
    leave_account(tmp_path, "nav", ["5 messages", "NOTHING WAS INJECTED"], vacuous=True)
    leave_account(tmp_path, "../map\x1b", ["7 messages"], vacuous=False)
    assert package_lines(tmp_path) == [
        "../map\\x1b: 7 messages",
        "nav: 5 messages",
        "nav: NOTHING WAS INJECTED",
        "tests of 2 packages, each through a router of its own; NOTHING SHOWN by nav",
    ]


def test_no_package_at_all(tmp_path: Path) -> None:
    (line,) = package_lines(tmp_path)
    assert line.startswith("NO TESTS OF A PACKAGE WENT THROUGH A ROUTER")
