"""Agent and controller, parted in every way that a network knows, again and again."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until
from riot_bus_fleet.agent.remote_operation import RemoteOperation, ask_robot
from tests.integration.agent_tools import Cable, Process, agent
from tests.integration.play_tools import MS, numbered, write
from tests.integration.zenoh_process import ZenohProcess
from tests.tiers import scaled

pytestmark = pytest.mark.integration

GRACE_S = 4.0
SHORT_S = 1.0
"""With a second for each question that waits in vain and half a second between two, well below the grace time."""

LATE_S = 6.0
"""How much later than its grace an operation may end on a busy machine."""

FAULTS = ("cut", "frozen", "delayed", "flooded", "killed")


@contextmanager
def fault(kind: str, cable: Cable, hub: str) -> Iterator[None]:
    """Something is wrong with a link as long as this lasts."""
    with ExitStack() as stack:
        if kind == "cut":
            cable.cut()
            stack.callback(cable.restore)
        elif kind == "frozen":  # a pulled plug, or a connection that is half open: nobody is told
            cable.freeze()
            stack.callback(cable.thaw)
        elif kind == "delayed":
            cable.delay = 0.3
            stack.callback(setattr, cable, "delay", 0.0)
        elif kind == "flooded":
            over, client = threading.Event(), stack.enter_context(open_client(hub))
            thread = threading.Thread(target=_flood, args=(client.session, over))
            thread.start()
            stack.callback(thread.join)
            stack.callback(over.set)
        yield


def _flood(session: Any, over: threading.Event) -> None:
    while not over.wait(0.001):
        for name in ("status", "logs", "controller/0"):
            session.get(f"@riot/r7/agent/{name}", lambda _: None, timeout=1.0, target=zenoh.QueryTarget.ALL)


@pytest.mark.timeout(1800)  # a hundred rounds by night, each with a grace to wait out
def test_no_operation_outlives_its_grace_and_none_ends_without_need(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    write(logs / "log.mcap", numbered(6000, "a/x", period=50 * MS))
    rng = random.Random(7)
    with (
        ZenohProcess("router") as bus,
        ZenohProcess("router") as router,
        Cable(hub := router.locators[0]) as robots,
        Cable(hub) as controllers,
        agent(logs, bus.locators[0], robots.endpoint) as robot,
    ):
        for number in range(scaled(100, gate=3)):
            kind, long = rng.choice(FAULTS), rng.random() < 0.5
            kind = "flooded" if kind == "killed" and not long else kind
            cable = controllers if kind == "killed" else rng.choice([robots, controllers])
            print(f"round {number}: {kind}, {'long' if long else 'short'}", flush=True)
            _round(hub, robot, controllers, cable, kind, long=long)


def _round(hub: str, robot: Process, controllers: Cable, cable: Cable, kind: str, *, long: bool) -> None:
    parts = kind in ("cut", "frozen", "killed")
    with RemoteOperation(controllers.endpoint, "r7") as operation:
        assert wait_until(lambda: _state(hub) is not None, 60), "the agent has not come back"
        operation.begin("play", {"logs": ["log.mcap"], "wait": 0.0, "grace": GRACE_S, "who": kind})
        operation.follow(lambda *_: None, give_up=30, until=lambda status: status["state"] == "playing")
        if kind == "killed":
            controllers.cut()
            controllers.restore()
            operation.__exit__()
        began = time.monotonic()
        with fault(kind, cable, hub):
            if long and parts:
                robot.expect(f"play stopped: the controller was lost for {GRACE_S:g} s", GRACE_S + LATE_S)
                assert time.monotonic() - began > GRACE_S - 1.5, "it was lost before its grace was over"
            else:
                time.sleep(GRACE_S + 2.0 if long else SHORT_S)  # the fault lasts so long; nothing is waited for
        if long and parts:
            return
        time.sleep(GRACE_S + 1.0)  # what was to end in spite of all would have ended by now
        assert wait_until(lambda: _state(hub) is not None, 60)
        assert _state(hub) == "playing", "it ended without need"
        ask_robot(hub, "r7", "stop", who="the test")
        robot.expect("play stopped: stopped by the test")


def _state(hub: str) -> str | None:
    """Return the state of the robot's operation, empty if there was none; None if the robot is not heard."""
    try:
        return str((ask_robot(hub, "r7", "status")["operation"] or {"state": ""})["state"])
    except EnvironmentFaultError:
        return None
