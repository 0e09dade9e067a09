from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading

import pytest

from riot_bus.processes.attached import attached_command, connected, wait_for_end

CLIENT = """
import socket, sys
with socket.create_connection(("127.0.0.1", int(sys.argv[1]))) as link:
    print("connected", flush=True)
    link.recv(1)
"""


def client(port: int) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-S", "-c", CLIENT, str(port)], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "connected\n"
    process.stdout.close()
    return process


def test_who_has_connected_is_found_and_its_end_is_noticed() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        stand_in = subprocess.Popen(attached_command(port), stdout=subprocess.PIPE, text=True)
        assert stand_in.stdout is not None
        with stand_in, stand_in.stdout, socket.create_connection(("127.0.0.1", port)):  # riot's own does not count
            process = client(port)
            with process, server.accept()[0], server.accept()[0]:
                assert stand_in.stdout.readline() == f"[{process.pid}]\n"
                assert connected(port, to=os.getpid()) == [process.pid]
                assert connected(port, to=process.pid) == []
                process.kill()
            assert stand_in.stdout.readline() == f"process {process.pid} has ended\n"
        assert stand_in.returncode == 0


def test_a_process_that_is_gone_has_ended() -> None:
    process = subprocess.Popen(["true"])
    process.wait()
    assert wait_for_end([process.pid]) == process.pid


@pytest.mark.timeout(60)
def test_the_first_end_of_several_counts() -> None:
    stays, ends = (subprocess.Popen(["sleep", "95.5"]) for _ in range(2))
    try:
        threading.Timer(0.1, ends.kill).start()
        assert wait_for_end([stays.pid, ends.pid]) == ends.pid
    finally:
        stays.kill()
        stays.wait()
        ends.wait()
