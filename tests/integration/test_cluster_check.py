"""`riot cluster check`: what each worker says, and by what exit code."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.zenoh.session import wait_until
from tests.dask_cluster import DaskCluster
from tests.systems.misbehaviour.catalogue import write

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]


@pytest.mark.nightly
def test_workers_with_other_code_or_several_threads_are_named(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    path = write(tmp_path / "one")
    shutil.copytree(tmp_path / "one", tmp_path / "two")
    with (tmp_path / "two/node.py").open("a") as stream:
        stream.write("# other\n")
    with DaskCluster(tmp_path / "dask", 1) as cluster:
        cluster.start_worker(1, RIOT_SYSTEM=str(tmp_path / "two/riot.toml"))
        cluster.start_worker(2, "--nthreads=2")

        def check() -> tuple[int, list[dict[str, str]]]:
            command = [sys.executable, "-m", "riot_bus", "cluster", "check", cluster.executor, f"--system={path}"]
            done = subprocess.run([*command, "--format=json"], capture_output=True, text=True, check=False)
            return done.returncode, json.loads(done.stdout)

        assert wait_until(lambda: cluster.registered() == 3, 60)
        code, found = check()
    assert code == 4
    same, other, threads = sorted((each["refused"] for each in found), key=len)
    assert same == ""
    assert other.startswith("it has 2 threads") or threads.startswith("it has 2 threads")
    assert any("code node.py is" in each and "where riot runs" in each for each in (other, threads))
