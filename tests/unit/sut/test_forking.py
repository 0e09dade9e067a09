"""Which commands can be forked."""

from __future__ import annotations

from pathlib import Path

from riot_bus.sut.forking import fork_of


def test_only_python_programs_are_forked(tmp_path: Path) -> None:
    def forked(*argv: str, varying: frozenset[str] = frozenset()) -> bool:
        return fork_of(argv, env={}, varying=varying, cwd=tmp_path, modules=["json"]) is not None

    assert forked("/usr/bin/python3.12", "-X", "dev", "-O", "node.py", "--x")
    assert forked("python", "-m", "node")
    assert forked("python", "-Wignore", "-W", "error", "-X", "dev", "node.py")
    assert not forked("python", "-c", "pass")
    assert not forked("python", "node")  # a folder, or a file of unknown kind
    assert not forked("bash", "node.py")
    assert not forked("python", "node.py", varying=frozenset({"PYTHONPATH"}))
    assert fork_of(["python", "node.py"], env={}, varying=frozenset(), cwd=tmp_path, modules=[]) is None
