from __future__ import annotations

import json
from pathlib import Path

from riot_bus_fleet.agent.options import AgentOptions
from riot_bus_fleet.agent.service import AgentService


def test_what_is_behind_the_hash_of_an_endpoint_is_not_told(tmp_path: Path) -> None:
    options = AgentOptions(
        robot="r7",
        folder=tmp_path,
        endpoint="tls/bus:1#key=s3kR1t",
        fleet="tls/fleet:1#key=s3kR1t",
        fleet_config={"transport/auth/usrpwd/password": "s3kR1t"},
    )
    status = AgentService(options).status()
    assert status["bus"] == "tls/bus:1#..."
    assert "s3kR1t" not in json.dumps(status)
