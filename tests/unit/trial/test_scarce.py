from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest

from riot_bus.system.system_file import SystemFile, load_system
from riot_bus.trial.scarce import held
from riot_bus.vocabulary.errors import ConfigError

HOLDS = """
import sys, time
from pathlib import Path
from riot_bus.trial.scarce import held
from riot_bus.system.system_file import load_system
with held(load_system(Path(sys.argv[1])), ["one", "one"]):
    print("has both", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SystemFile:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    path = tmp_path / "riot.toml"
    path.write_text(
        '[resources]\nsim = 2\ngpu = 1\n[components.none]\ncommand = ["a"]\n'
        '[components.one]\ncommand = ["a"]\nresources = { sim = 1 }\n'
        '[components.more]\ncommand = ["a"]\nresources = { sim = 1, gpu = 1 }\n'
    )
    return load_system(path)


def test_never_more_at_once_than_there_are_and_all_get_their_turn(file: SystemFile) -> None:
    lock, now, most = threading.Lock(), 0, 0
    both = threading.Barrier(2, timeout=60)

    def trial(names: list[str], *, together: bool = False) -> int:
        nonlocal now, most
        with held(file, names):
            with lock:
                now += len(names)
                most = max(most, now)
            if together:
                both.wait()
            with lock:
                now -= len(names)
        return len(names)

    kinds = [["one"], ["one"], ["one", "more"], ["more"], ["one", "one"], ["one", "more"], ["one"], ["one"]]
    with ThreadPoolExecutor(len(kinds)) as pool:
        assert sum(pool.map(partial(trial, together=True), [["one"], ["one"]])) == 2
        assert sum(pool.map(trial, kinds)) == 11
    assert most == 2


def test_who_needs_nothing_does_not_wait_and_what_a_killed_process_had_is_free(file: SystemFile) -> None:
    other = subprocess.Popen(
        [sys.executable, "-c", HOLDS, str(file.path)], stdout=subprocess.PIPE, text=True, env=dict(os.environ)
    )
    assert other.stdout is not None
    assert other.stdout.readline() == "has both\n"
    with held(file, ["none"]):
        pass
    threading.Timer(0.3, other.kill).start()
    with held(file, ["one"]):
        assert other.wait(60) != 0
    other.stdout.close()


@pytest.mark.parametrize("below", [False, True])
def test_what_another_user_made_first_is_refused_at_once(file: SystemFile, tmp_path: Path, *, below: bool) -> None:
    with held(file, ["one"]):
        pass
    (root,) = tmp_path.glob("riot-resources-*")
    (folder,) = root.iterdir()
    (folder / "sim.queue").unlink()
    (folder / "sim.queue").symlink_to(tmp_path / "made-for-another")
    (folder if below else root).chmod(0o777)  # as if another one had made it so that we can enter it
    with pytest.raises(ConfigError, match="others may write there"), held(file, ["one"]):
        pass
    assert not (tmp_path / "made-for-another").exists()
