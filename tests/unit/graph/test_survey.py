from __future__ import annotations

import os
import socket
import subprocess

import pytest

from riot_bus.graph.survey import started_at

CONNECTS = 'exec 3<>"/dev/tcp/127.0.0.1/$0"; read <&3'


@pytest.mark.parametrize("user", [None, 65534], ids=["this user", "nobody"])
def test_only_processes_of_this_user_are_told_with_their_commands(user: int | None) -> None:
    if user is not None and os.geteuid() != 0:
        pytest.skip("only root can start a process of another user")
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60)
        port = str(server.getsockname()[1])
        with subprocess.Popen(["bash", "-c", CONNECTS, port], user=user, cwd="/") as process:
            end, _ = server.accept()
            found = started_at(f"tcp/127.0.0.1:{port}")
            end.close()
            process.wait(60)
    assert [each.pid for each in found] == ([] if user else [process.pid])
