"""The view that monitors judge, of parts that are written down."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.system.system_file import SystemFile, load_system
from riot_bus.trial.setup import TrialSetup, held
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError


def setup(*, status: int | None = None, attach: str | None = None, reasons: dict[str, int] | None = None) -> TrialSetup:
    """Return a setup with one component, whose process has this status, and whose link has stalled."""
    made: Any = TrialSetup.__new__(TrialSetup)
    process = SimpleNamespace(
        status=status, excess=None, stack=(), unread=0, errors=lambda: "err", printed=lambda: "out"
    )
    component = SimpleNamespace(tracebacks="fail", attach=attach)
    made.context = SimpleNamespace(file=SimpleNamespace(components={"part": component}), registry=None)
    made.processes = SimpleNamespace(
        started={"part": process},
        alive=lambda names: status is None,
        check_way=lambda name: None,
        folders={"part": Path("code")},
        excess=lambda name: None,
    )
    made.observation = SimpleNamespace(samples=lambda name: ())
    losses = SimpleNamespace(reasons=reasons or {}, links=[SimpleNamespace(segment="inner", reason="stalled")])
    made.network = SimpleNamespace(
        bus=SimpleNamespace(losses=losses), inputs=[], outputs=[], now=lambda: 9, segment_of=lambda name: "inner"
    )
    made._begin, made._killed = 3, 0
    return made  # type: ignore[no-any-return]


def test_a_view_has_what_components_printed_and_which_links_stalled() -> None:
    view = setup(status=1).view(["part"], settled=True, waited=2.0)
    (component,) = view.components
    assert (component.status, component.errors, component.printed) == (1, "err", "out")
    assert (view.begin, view.end, view.stalled, view.settled) == (3, 9, ["part"], True)


def test_outputs_that_came_too_fast_are_no_verdict_unless_they_never_end() -> None:
    late = setup(reasons={"observer too slow": 5})
    with pytest.raises(EnvironmentFaultError, match="5 outputs came faster"):
        late.view(["part"], settled=True, waited=2.0)
    assert not late.view(["part"], settled=False, waited=2.0).settled


def test_what_the_kernel_has_killed_for_memory_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("riot_bus.trial.setup.out_of_memory_kills", lambda: 1)
    with pytest.raises(EnvironmentFaultError, match="no memory left"):
        setup(status=-signal.SIGKILL).component_view("part")


def test_the_status_of_a_process_that_riot_did_not_start_is_not_known() -> None:
    assert setup(status=0, attach="tcp/1:1").component_view("part").signs.ended == "its process has ended"
    assert not setup(attach="tcp/1:1").component_view("part").signs.ended


HOLDS = """
import sys, time
from pathlib import Path
from riot_bus.trial.setup import held
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
