"""Which commands can be forked."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from riot_bus.processes.forking import Fork, fork_of

ENTRY_POINT = """#!{interpreter}
import re
import sys
from my_nodes.main import main
if __name__ == '__main__':
    sys.exit(main())
"""


def forked(
    cwd: Path, *argv: str, varying: frozenset[str] = frozenset(), modules: Sequence[str] = ("json",), path: str = ""
) -> Fork | str:
    return fork_of(argv, env={"PATH": path}, varying=varying, cwd=cwd, modules=modules)


def write(path: Path, text: str) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)


def test_only_python_programs_are_forked(tmp_path: Path) -> None:
    for words in (
        ("/usr/bin/python3.12", "-X", "dev", "-O", "node.py", "--x"),
        ("python", "-m", "node"),
        ("python", "-Wignore", "-W", "error", "-X", "dev", "node.py"),
    ):
        assert isinstance(forked(tmp_path, *words), Fork)
    (tmp_path / "folder").mkdir()
    (tmp_path / "archive").write_bytes(b"#!/usr/bin/python3\nPK\x03\x04\x00")
    for words in (
        ("python", "-c", "pass"),
        ("python", "node"),
        ("python", "folder"),
        ("python", "archive"),
        ("python",),
    ):
        assert forked(tmp_path, *words) == "its command is not a Python script or module"
    assert forked(tmp_path, "bash", "node.py") == "its command is not a Python script or module"
    varying = frozenset({"PYTHONPATH", "OTHER"})
    assert forked(tmp_path, "python", "node.py", varying=varying) == "PYTHONPATH differs from trial to trial"
    assert forked(tmp_path, "python", "node.py", modules=[]) == ""  # whether it is a Python program is not known yet


@pytest.mark.parametrize(
    ("first", "interpreter"),
    [
        ("#!/usr/bin/python3", ["/usr/bin/python3"]),
        ("#! /usr/bin/python3 -Es ", ["/usr/bin/python3", "-Es"]),
        ("#!/usr/bin/env python3", ["python3"]),
        ("#!/usr/bin/env -S python3 -u", ["python3", "-u"]),
        ("#!/usr/bin/env python3 -u", None),  # env looks for a program called so
        ("#!/usr/bin/env", None),
        ("#!/bin/sh", None),
        ("#!", None),
        ("import sys", None),
    ],
)
def test_scripts_that_name_their_interpreter(tmp_path: Path, first: str, interpreter: list[str] | None) -> None:
    write(tmp_path / "bin" / "node", f"{first}\nimport sys\n")
    for words in (("bin/node", "--x"), (str(tmp_path / "bin" / "node"), "--x")):
        fork = forked(tmp_path, *words)
        assert (list(fork.interpreter) if isinstance(fork, Fork) else None) == interpreter
        if isinstance(fork, Fork):
            assert (fork.module, list(fork.words), fork.own) == (None, list(words), str(tmp_path / "bin"))
    fork = forked(tmp_path, "node", path=str(tmp_path / "bin"))
    assert isinstance(fork, Fork) == (interpreter is not None)
    assert not isinstance(fork, Fork) or fork.words == [str(tmp_path / "bin" / "node")]
    (tmp_path / "bin" / "node").chmod(0o644)
    assert isinstance(forked(tmp_path, "bin/node"), str)  # it cannot be executed


def test_files_of_any_name_are_forked_if_they_are_text(tmp_path: Path) -> None:
    (tmp_path / "node").write_text("import json\n")
    fork = forked(tmp_path, "python", "node")
    assert isinstance(fork, Fork)
    assert fork.words == ("node",)


def test_what_an_installed_program_imports_itself_is_imported_by_each_process_anew(tmp_path: Path) -> None:
    write(tmp_path / "bin" / "node", ENTRY_POINT.format(interpreter=sys.executable))
    modules = ["numpy", "my_nodes", "my_nodes.main", "numpy.linalg", "my_nodes_too"]
    fork = forked(tmp_path, "bin/node", modules=modules)
    assert isinstance(fork, Fork)
    assert fork.modules == ["numpy", "numpy.linalg", "my_nodes_too"]
    write(tmp_path / "bin" / "node", "#!/usr/bin/python3\nload_entry_point('my-nodes==1', 'console_scripts', 'n')()\n")
    fork = forked(tmp_path, "bin/node", modules=modules)
    assert isinstance(fork, Fork)
    assert fork.modules == ["numpy", "numpy.linalg", "my_nodes_too"]
