"""How a process ends that has used Zenoh."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.integration.router_process import ENVIRONMENT

pytestmark = pytest.mark.integration

ENDING = """
import sys, threading, time
from riot_bus.zenoh.session import open_session, release

class Slow:
    def __del__(self, sleep=time.sleep):
        sleep(1)  # the interpreter takes so long to go down, while nobody else may have it

sys.slow = Slow()
called, never = threading.Event(), threading.Event()

def take(sample):
    called.set()
    never.wait(0.3)

def use():
    config = {"mode": "peer", "scouting/multicast/enabled": False, "listen/endpoints": []}
    session = open_session(config, purpose="test")
    subscriber = session.declare_subscriber("a", take)
    session.put("a", b"")
    assert called.wait(10)
    release(subscriber, session)

thread = threading.Thread(target=use, daemon=True)
thread.start()
thread.join()
print("used")
"""


def test_callbacks_declared_on_a_daemon_thread_end_before_the_interpreter() -> None:
    """As an agent's operations do; it aborted."""
    done = subprocess.run(
        [sys.executable, "-c", ENDING], capture_output=True, text=True, timeout=60, env=ENVIRONMENT, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "used\n", "")
