"""requirements.lock has what pyproject.toml wants, for each Python and processor that bootstrap.py locks."""

from __future__ import annotations

import re
import runpy
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
TOOL: dict[str, Any] = runpy.run_path(str(ROOT / ".ci" / "lock.py"))
TARGETS = [(python, machine) for python in TOOL["PYTHONS"] for machine in TOOL["MACHINES"]]


def entries() -> list[tuple[Requirement, list[str]]]:
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8").replace("\\\n", " ")
    found = []
    for line in text.splitlines():
        if not line.startswith("#"):
            requirement, *hashes = re.split(r"\s+--hash=", line.strip())
            found.append((Requirement(requirement), hashes))
    return found


def test_each_release_has_hashes_and_no_place() -> None:
    for requirement, hashes in entries():
        assert hashes, requirement
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", each) for each in hashes), requirement
        assert requirement.url is None
    assert "://" not in (ROOT / "requirements.lock").read_text(encoding="utf-8")


@pytest.mark.parametrize(("python", "machine"), TARGETS)
def test_what_is_wanted_is_locked_once(python: str, machine: str) -> None:
    environment = {"python_version": python, "python_full_version": f"{python}.0", "platform_machine": machine}
    locked: dict[str, str] = {}
    for requirement, _ in entries():
        if requirement.marker is None or requirement.marker.evaluate(environment):
            (version,) = (each.version for each in requirement.specifier)
            assert requirement.name not in locked
            locked[requirement.name] = version
    for text in TOOL["wanted"](tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))):
        wanted = Requirement(text)
        assert wanted.specifier.contains(locked[wanted.name.lower()], prereleases=True), text


def test_bootstrap_knows_the_same_pythons() -> None:
    bootstrap = runpy.run_path(str(ROOT / "bootstrap.py"))
    assert [f"{major}.{minor}" for major, minor in bootstrap["LOCKED_PYTHONS"]] == list(TOOL["PYTHONS"])
    assert bootstrap["LOCKED_MACHINES"] == TOOL["MACHINES"]


def test_markers_say_where_a_release_is_wanted() -> None:
    marker = TOOL["marker"]
    assert marker(set(TARGETS)) == ""
    some = {("3.11", "x86_64"), ("3.11", "aarch64"), ("3.13", "aarch64")}
    text = marker(some)
    assert text == " ; python_version == '3.11' or (python_version == '3.13' and platform_machine == 'aarch64')"
    found = Requirement(f"x==1{text}").marker
    assert found is not None
    assert {
        each for each in TARGETS if found.evaluate({"python_version": each[0], "platform_machine": each[1]})
    } == some
