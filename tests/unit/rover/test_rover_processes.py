import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh
from rover.bus import attachment
from rover.messages import PoseStamped
from rover.sensors import Odometry
from rover.topics import key

pytestmark = pytest.mark.integration
ROVER = Path(__file__).parents[3] / "examples" / "rover"
DEADLINE = 30.0


def until(condition):
    deadline = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


@contextmanager
def router():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    quiet = "scouting: {delay: 0, multicast: {enabled: false}}"
    text = f'{{mode: "router", listen: {{endpoints: ["{endpoint}"]}}, {quiet}}}'
    session = zenoh.open(zenoh.Config.from_json5(text))
    try:
        yield session, endpoint
    finally:
        session.close()


@contextmanager
def processes(endpoint, names, *options):
    running = {}
    try:
        for name in names:
            extra = options if name in ("sim", "operator_") else ()
            command = [sys.executable, "-m", f"rover.{name}", "--connect", endpoint, *extra]
            running[name] = subprocess.Popen(command, cwd=ROVER, stderr=subprocess.PIPE, text=True)
        yield running
    finally:
        for process in running.values():
            process.kill()
            process.wait()
            process.stderr.close()


@pytest.mark.load  # drives 10 times as fast as real time
def test_the_whole_system_drives_and_stops_cleanly():
    names = ["planner", "mapper", "controller", "operator_", "sim"]
    seen = {"/plan": 0, "/cmd_vel": 0, "/odom": 0}
    attachments = []
    with router() as (session, endpoint):

        def count(topic):
            def take(sample):
                seen[topic] += 1
                attachments.append(sample.attachment.to_bytes())

            return take

        subscribers = [session.declare_subscriber(key(topic), count(topic)) for topic in seen]
        options = "--speed", "10", "--duration", "20", "--seed", "7"
        with processes(endpoint, names, *options) as running:
            assert running["sim"].wait(DEADLINE) == 0
            assert running["operator_"].wait(DEADLINE) == 0
            until(lambda: seen["/odom"] == 500 and seen["/plan"] > 20 and seen["/cmd_vel"] > 100)
            for name in names[:3]:
                running[name].terminate()
                assert running[name].wait(DEADLINE) == 0
                assert running[name].stderr.read() == ""
        assert all(len(raw) == 33 for raw in attachments)
        del subscribers


def test_a_goal_in_the_south_kills_the_planner():
    with router() as (session, endpoint), processes(endpoint, ["planner", "mapper"]) as running:
        goals = session.declare_publisher(key("/goal"))
        odometry = session.declare_publisher(key("/odom"))
        until(lambda: goals.matching_status.matching and odometry.matching_status.matching)
        goal = PoseStamped((0, 0), 0.0, -90.0).encode()
        place = Odometry((0, 0), 0.0, 0.0, 0.0, 0.0).encode()
        tag = attachment(1, 0, bytes(16))

        def planner_died():
            goals.put(goal, attachment=tag)
            odometry.put(place, attachment=tag)
            return running["planner"].poll() is not None

        until(planner_died)
        assert running["planner"].returncode in (1, -signal.SIGABRT)  # Zenoh's threads may abort a dying interpreter
        assert "ValueError: Array length must be >= 0" in running["planner"].stderr.read()
        assert running["mapper"].poll() is None


def test_mistakes_on_the_command_line_are_named():
    for words, complaint in (
        (["--sped", "2"], "unknown option '--sped'"),
        (["--speed", "fast"], "'fast' is not a number"),
        (["--speed", "0"], "out of range"),
        (["--seed"], "needs a value"),
    ):
        done = subprocess.run([sys.executable, "-m", "rover.sim", *words], cwd=ROVER, capture_output=True, text=True)
        assert done.returncode == 2
        assert complaint in done.stderr
