"""`riot init` describes a plain Zenoh system so that `riot test` runs on the file as it was written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.findings.records import CampaignRecord
from riot_bus.trial.context import open_system
from tests.integration.plain_system import plain_system
from tests.integration.router_process import RouterProcess, riot

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

CONFIG = """{
  mode: "client",                      // JSON5
  connect: { endpoints: ["ENDPOINT"] },
}
"""


def test_three_processes_of_one_segment_become_a_file_that_can_be_tested(tmp_path: Path) -> None:
    path, nominal = tmp_path / "riot.toml", tmp_path / "logs/nominal.mcap"
    nominal.parent.mkdir()
    secret = {"SIM_API_TOKEN": "s3cret", "PLAIN_MODE": "field"}
    with RouterProcess(endpoints={"system": "tcp/127.0.0.1:0"}) as router:
        endpoint = router.endpoints["system"]
        (tmp_path / "zenoh.json5").write_text(CONFIG.replace("ENDPOINT", endpoint))
        words = {
            "sim": ["--connect", endpoint.replace("127.0.0.1", "localhost")],
            "planner": ["--config=zenoh.json5"],
            "arm": [f"--connect={endpoint}"],
        }
        with plain_system(tmp_path, words, secret) as pids:
            code, out, err = riot("init", "-e", endpoint, "--seconds=1", "-o", path, cwd=tmp_path)
            assert (code, "--start starts each component once" in out) == (0, True), (out, err)
            assert "FILL IN components.node_planner: what it reads and writes" in out
            assert "FILL IN external: who publishes plan/cmd" in out
            file = open_system(path).file
            assert {name: each.inputs for name, each in file.components.items()} == dict.fromkeys(
                ("node_sim", "node_planner", "node_arm"), ()
            )

            more = ("--start", f"--record={nominal}", "--force", "--format=json")
            code, out, err = riot("init", "-e", endpoint, "--seconds=2", "-o", path, *more, cwd=tmp_path)
            assert code == 0, err
    assert "s3cret" not in path.read_text() + out
    found = json.loads(out)
    assert {each["name"]: each["pid"] for each in found["components"]} == {
        f"node_{role}": pid for role, pid in pids.items()
    }
    file = open_system(path).file
    sim, planner, arm = (file.components[f"node_{role}"] for role in pids)
    assert sim.command == ("{python}", "node.py", "sim", "--connect", "{endpoint}")
    assert planner.command == ("{python}", "node.py", "planner", "--config={file:zenoh.riot.json5}")
    assert (tmp_path / "zenoh.riot.json5").read_text() == CONFIG.replace("ENDPOINT", "{endpoint}")
    assert arm.command == ("{python}", "node.py", "arm", "--connect={endpoint}")
    assert sim.env == {"PLAIN_MODE": "field"}
    assert sim.cwd == "."
    assert (sim.inputs, sim.outputs, sim.external) == ((), ("imu/raw", "robot/*/pose"), True)
    assert (planner.inputs, planner.outputs) == (("robot/*/pose",), ("plan/cmd",))
    assert (arm.inputs, arm.outputs) == (("imu/raw", "plan/cmd"), ())
    assert (sim.segment, planner.segment, arm.segment) == ("outside", "inside", "inside")
    assert file.external.topics == ("imu/raw", "robot/1/pose", "robot/2/pose")
    assert file.system.types == {"plan/cmd": "cbor"}
    assert file.system.nominal == "logs/nominal.mcap"
    assert set(file.unit) == {"node_planner", "node_arm"}
    left = [each.partition(":")[0] for each in found["fill_in"]]
    assert left == ["types", "components.node_sim", "components.node_planner", "components.node_arm"]
    assert "imu/raw: 12 bytes: no codec reads them" in found["fill_in"][0]
    assert all("SIM_API_TOKEN" in each for each in found["fill_in"][1:])

    code, out, err = riot("test", "--unit=node_planner", "--trials=10", "--system", path, "--out", tmp_path / "out")
    assert code in (0, 1), (out, err)
    assert CampaignRecord.load(tmp_path / "out").tested >= 10


def test_what_does_not_work_when_it_is_started_is_said(tmp_path: Path) -> None:
    path = tmp_path / "riot.toml"
    with RouterProcess(endpoints={"system": "tcp/127.0.0.1:0"}) as router:
        endpoint = router.endpoints["system"]
        with plain_system(tmp_path, {"sim": ["--connect", endpoint], "arm": ["--connect", endpoint]}):
            broken = (tmp_path / "node.py").read_text().replace("import zenoh\n", 'raise SystemExit("no license")\n')
            (tmp_path / "node.py").write_text(broken)
            code, out, err = riot("init", "-e", endpoint, "--seconds=1", "-o", path, "--start", cwd=tmp_path)
    assert code == 0, err
    why = "what makes it work when riot starts it: it ended with status 1: no license"
    assert f"FILL IN components.node_sim: {why}" in out
    assert f"# FILL IN: {why}." in path.read_text()
    assert set(open_system(path).file.components) == {"node_sim", "node_arm"}
