"""A cluster that speaks TLS, as docs/cluster.md says: nobody without a certificate gets in, and trials are the same."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.zenoh.session import wait_until
from tests.dask_cluster import DaskCluster
from tests.systems.misbehaviour.catalogue import write

pytestmark = [
    pytest.mark.integration,
    pytest.mark.timeout(300),
    pytest.mark.skipif(shutil.which("openssl") is None, reason="makes certificates with openssl"),
]


def certificates(folder: Path, name: str) -> dict[str, str]:
    """Make an authority and a certificate of it; return the environment that names them for all of Dask."""
    folder.mkdir()

    def openssl(*arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True, timeout=30)

    new = ("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    openssl(*new, "-x509", "-days", "2", "-subj", f"/CN={name}", "-keyout", "ca.key", "-out", "ca.pem")
    openssl(*new, "-subj", "/CN=riot", "-keyout", "own.key", "-out", "own.csr")
    signed = ("-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2")
    openssl("x509", "-req", "-in", "own.csr", *signed, "-out", "own.pem")
    tls = "DASK_DISTRIBUTED__COMM__TLS__"
    own = {
        f"{tls}{who}__{what}": str(folder / f"own.{ending}")
        for who in ("SCHEDULER", "WORKER", "CLIENT")
        for what, ending in (("CERT", "pem"), ("KEY", "key"))
    }
    return {f"{tls}CA_FILE": str(folder / "ca.pem"), **own}


@pytest.mark.nightly
def test_trials_need_a_certificate_of_the_clusters_authority_and_are_those_of_this_machine(tmp_path: Path) -> None:
    (tmp_path / "system").mkdir()
    path = write(tmp_path / "system", ["raises"])
    ours, theirs = (certificates(tmp_path / name, name) for name in ("ours", "theirs"))

    def riot(*words: str, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "riot_bus", *words, f"--system={path}"]
        return subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | environment)

    def tested(out: str, *more: str, environment: dict[str, str]) -> list[tuple[str, int]]:
        words = ("test", "--unit=raises", "--trials=12", f"--out={tmp_path / out}", "--format=json", *more)
        done = riot(*words, environment=environment)
        assert done.returncode == 1, done
        folders = sorted((tmp_path / out / "findings").iterdir())
        return [(json.loads((each / "finding.json").read_text())["signature"], done.returncode) for each in folders]

    with DaskCluster(tmp_path / "dask", 1, ours, tls=True) as cluster:
        assert wait_until(lambda: cluster.registered() == 1, 60)
        check = ("cluster", "check", cluster.executor, "--format=json")
        admitted = riot(*check, environment=ours)
        assert (admitted.returncode, [each["refused"] for each in json.loads(admitted.stdout)]) == (0, [""])
        for environment in ({}, theirs):
            refused = riot(*check, environment=environment)
            assert (refused.returncode, refused.stdout) == (4, "")
            assert ("if it speaks TLS" in refused.stderr) == (not environment)
        there = tested("there", f"--executor={cluster.executor}", environment=ours)
    assert there == tested("here", environment={}) != []
