from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from riot_bus.graph.survey import Started
from riot_bus.sut.process_facts import facts_of
from riot_bus.zenoh.session import wait_until


@contextmanager
def process(folder: Path, *command: str, **env: str) -> Iterator[Started]:
    with subprocess.Popen(command, cwd=folder, env={**os.environ, **env}, stdin=subprocess.PIPE) as running:
        try:
            assert wait_until(lambda: bool(psutil.Process(running.pid).cmdline()), 30)
            yield Started(running.pid, tuple(psutil.Process(running.pid).cmdline()), str(folder))
        finally:
            running.kill()


def test_environment_program_and_files_that_say_where_to_connect(tmp_path: Path) -> None:
    (tmp_path / "z.json5").write_text('{ connect: ["tcp/h:7447"] }')
    (tmp_path / "other.json").write_text('["tcp/h:7448"]')
    (tmp_path / "bytes").write_bytes(b"\xff tcp/h:7447")
    (tmp_path / "env.yaml").write_text("tcp/h:7447")
    words = ("-c", "input()", "--conf=z.json5", "other.json", "bytes", "missing", "")
    with process(tmp_path, sys.executable, *words, ZENOH_CONFIG="env.yaml", MARK="5") as started:
        found = facts_of(started, {7447})
    assert found.environment["MARK"] == "5"
    assert found.program == sys.executable
    assert {Path(path).name for path in found.files} == {"z.json5", "env.yaml"}


def test_a_python_is_that_of_riot_only_in_its_folder(tmp_path: Path) -> None:
    link = tmp_path / "python3"
    link.symlink_to(sys.executable)
    with process(tmp_path, str(link), "-c", "input()") as started:
        assert facts_of(started, ()).program == str(link)
    beside = Path(sys.executable).with_name("python3")
    if beside.exists():
        with process(tmp_path, str(beside), "-c", "input()") as started:
            assert facts_of(started, ()).program == sys.executable


def test_what_is_gone_is_as_it_was_started() -> None:
    found = facts_of(Started(2**22 + 1, ("no-such-program", "x"), "/"), {1})
    assert (found.program, found.environment, found.files) == ("", {}, {})
    assert found.command == ("no-such-program", "x")
