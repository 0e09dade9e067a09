"""A running `riot router` is looked at and changed while clients talk."""

from __future__ import annotations

import itertools
import json
import re
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import pytest
import zenoh

from riot_bus.control.remote import Remote, ask, find_routers
from riot_bus.graph.history import replay
from riot_bus.log.reader import LogReader
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.client import Client, open_client
from riot_bus.zenoh.session import free_endpoint, wait_until
from tests.integration.access_tools import write_private
from tests.integration.router_process import RouterProcess, riot

pytestmark = pytest.mark.integration

PERIOD_S = 0.001
GENEROUS_S = 2.0
PLAN = '[[inject]]\ntopic = "free/plan"\nfield = "v"\nvalue = 99\n'
BLOCK = Qos(congestion="block")


class Stream:
    """Numbered messages on several keys, and what arrives of them."""

    def __init__(self, router: RouterProcess, *keys: str) -> None:
        self.keys = keys
        self.sent = 0
        self.got: defaultdict[str, list[int]] = defaultdict(list)
        self.gaps: defaultdict[str, float] = defaultdict(float)
        self._last: dict[str, float] = {}
        self._source = open_client(router.endpoints["system"])
        self._sink = open_client(router.endpoints["unit"])
        self._sink.subscribe("*/*", self._take)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Self:
        def routed() -> bool:
            for key in self.keys:
                self._put(key, -1)
            return all(self.got[key] for key in self.keys)

        assert wait_until(routed, 60, interval=0.01)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.finish()
        self._source.close()
        self._sink.close()

    def finish(self) -> None:
        """Send no more."""
        self._stop.set()
        self._thread.join()

    def numbers(self, key: str) -> list[int]:
        return [number for number in self.got[key] if number >= 0]

    def arrived(self, number: int) -> bool:
        return all(self.got[key] and self.got[key][-1] >= number for key in self.keys)

    def wait(self, more: int) -> None:
        """Wait until so many more messages have arrived on each key."""
        goal = self.sent + more
        assert wait_until(lambda: self.arrived(goal), 60), {key: self.got[key][-1:] for key in self.keys}

    def _put(self, key: str, number: int) -> None:
        self._source.put(Message(0, key, str(number).encode(), qos=BLOCK))

    def _run(self) -> None:
        while not self._stop.wait(PERIOD_S):
            for key in self.keys:
                self._put(key, self.sent)
            self.sent += 1

    def _take(self, message: Message) -> None:
        number, now = int(message.payload), time.monotonic()
        self.got[message.key].append(number)
        self.gaps[message.key] = max(self.gaps[message.key], now - self._last.get(message.key, now))
        self._last[message.key] = now


@pytest.fixture
def router(tmp_path: Path) -> Iterator[RouterProcess]:
    with RouterProcess("--name=lab", "--intercept=cut/**", cwd=tmp_path) as running:
        assert running.ready.startswith("ready:"), running.end(2)
        yield running


def keys(*texts: str) -> bytes:
    return json.dumps({"keys": texts}).encode()


def test_intercepted_keys_change_while_messages_pass(router: RouterProcess, capsys: pytest.CaptureFixture[str]) -> None:
    with Stream(router, "cut/x", "turn/x", "free/x") as stream, Remote(router.endpoints["unit"]) as remote:
        stream.wait(100)
        assert remote.ask("intercept/add", keys("turn/**"))["intercepted"] == ["cut/**", "turn/**"]
        stream.wait(300)
        assert remote.ask("counts")["counts"]["turn/x"]["forwarded"] > 0
        assert remote.ask("intercept/remove", keys("turn/**"))["intercepted"] == ["cut/**"]
        stream.wait(300)
        stream.finish()
        assert wait_until(lambda: stream.arrived(stream.sent - 1), 60)
        losses = remote.ask("status")["losses"]
    assert stream.numbers("cut/x") == list(range(stream.sent))  # all, in order, once
    for key in stream.keys:
        assert stream.numbers(key) == sorted(set(stream.numbers(key))), f"{key}: repeated or out of order"
        assert stream.gaps[key] < GENEROUS_S
    missing = {key: stream.sent - len(stream.numbers(key)) for key in stream.keys}
    figures = ", ".join(f"{key}: gap {stream.gaps[key] * 1e3:.0f} ms, {missing[key]} missing" for key in stream.keys)
    with capsys.disabled():
        print(f"\nintercept add and remove: {figures}, of {stream.sent} each")
    assert losses["messages"] == 0


def test_recordings_begin_split_and_end_without_a_loss(router: RouterProcess, tmp_path: Path) -> None:
    with Stream(router, "cut/x", "free/x") as stream, Remote(router.endpoints["unit"]) as remote:
        stream.wait(20)
        assert remote.ask("record/start", b'{"path": "a.mcap"}')["file"] == str(tmp_path / "a.mcap")
        first = stream.sent + 1  # what was being sent at this moment may be in or out
        files = ["a.mcap"]
        for _ in range(3):
            stream.wait(150)
            files.append(Path(remote.ask("record/split")["file"]).name)
        stream.wait(50)
        stream.finish()

        def recorded() -> bool:
            counts = remote.ask("counts")["counts"]
            return all(counts[key]["recorded"] >= stream.sent - first for key in stream.keys)

        assert wait_until(lambda: stream.arrived(stream.sent - 1) and recorded(), 60, interval=0.05)
        assert remote.ask("record/stop")["lost"] == 0
    found: defaultdict[str, list[int]] = defaultdict(list)
    for name in files:
        with LogReader(tmp_path / name) as reader:
            assert not reader.loss
            for message in reader.messages():
                found[message.key].append(int(message.payload))
            assert next(graph for _, graph in replay(reader.notes("riot_bus.graph"))).components
    for key in stream.keys:
        numbers = [number for number in found[key] if number >= first]
        assert numbers == list(range(first, stream.sent)), key


def test_plans_are_loaded_and_cleared(router: RouterProcess) -> None:
    with (
        open_client(router.endpoints["system"]) as source,
        open_client(router.endpoints["unit"]) as sink,
        Remote(router.endpoints["system"], "lab") as remote,
    ):
        got: list[bytes] = []
        sink.subscribe("free/plan", lambda message: got.append(message.payload))

        def arrives(payload: bytes) -> Callable[[], bool]:
            def ask() -> bool:
                source.put(Message(0, "free/plan", b'{"v": 1}', qos=BLOCK))
                return payload in got[-1:]

            return ask

        assert wait_until(arrives(b'{"v": 1}'), 60, interval=0.01)
        answer = remote.ask("plan/load", PLAN.encode(), parameters="name=p.toml")
        assert (answer["plan"]["name"], answer["intercepted"]) == ("p.toml", ["cut/**", "free/plan"])
        assert wait_until(arrives(b'{"v": 99}'), 60, interval=0.01)
        assert remote.ask("status")["plan"]["hits"] > 0
        assert remote.ask("plan/clear")["plan"] is None
        assert wait_until(lambda: remote.ask("status")["intercepted"] == ["cut/**"], 60, interval=0.05)
        assert wait_until(arrives(b'{"v": 1}'), 60, interval=0.01)


def test_urgent_commands_are_answered_beside_slow_ones(
    router: RouterProcess, capsys: pytest.CaptureFixture[str]
) -> None:
    """Beside `test_a_flood_of_questions_does_not_hold_up_a_stop`, whose questions take no time.

    Each is asked when the one before is answered. If one waited for a slow command to end, or for what is done at once
    with it, then no further one would be answered before that. A single answer may be late, on a slow machine by more,
    but not by as much as a slow command takes there.
    """
    many = json.dumps({"keys": [f"slow/{number}" for number in range(200)]}).encode()
    slow = {"intercept/add": many, "plan/load": PLAN.encode(), "record/start": b"", "intercept/remove": many}
    urgent = ("status", "plan/clear", "record/stop")
    rounds, done = 3, threading.Event()
    begun: list[tuple[str, float]] = []
    answers: list[tuple[str, float, float]] = []
    with Remote(router.endpoints["unit"], "lab") as remote, open_client(router.endpoints["system"]) as flooder:

        def flood() -> None:
            for name, payload in [*slow.items()] * rounds:
                begun.append((name, time.monotonic()))
                raw(flooder, f"@riot/lab/{name}", payload=payload)
            begun.append(("", time.monotonic()))
            done.set()

        thread = threading.Thread(target=flood)
        thread.start()
        while not done.is_set():
            for command in urgent:
                began = time.monotonic()
                with suppress(ConfigError):  # there may be no recording
                    remote.ask(command)
                answers.append((command, began, time.monotonic()))
        thread.join()
    spans = [(name, begin, end) for (name, begin), (_, end) in itertools.pairwise(begun)]
    for slow_one, begin, end in spans:
        beside = Counter(name for name, asked, answered in answers if begin < asked and answered < end)
        with capsys.disabled():
            print(f"\n{slow_one} took {end - begin:.2f} s, beside it were answered {dict(beside)}", end="")
        assert slow_one == "record/start" or min(beside[name] for name in urgent) > 1, slow_one  # that is short
    assert len(spans) == rounds * len(slow)
    latest = max(answered - asked for _, asked, answered in answers)
    assert latest < max(end - begin for _, begin, end in spans) / 2


def raw(client: Client, key: str, **more: Any) -> list[zenoh.Reply]:
    return list(client.session.get(key, timeout=60, target=zenoh.QueryTarget.ALL, **more))


def test_hostile_input_is_answered_and_does_nothing(router: RouterProcess) -> None:
    with open_client(router.endpoints["unit"]) as client:
        replies = raw(client, "@riot/**")  # means what only reads, whatever else is there
        assert sorted(str(reply.ok.key_expr) for reply in replies if reply.ok) == [
            f"@riot/lab/{name}" for name in ("counts", "graph", "status")
        ]
        for key, payload in (
            ("@riot/lab/plan/load", b"\xff" * 100),
            ("@riot/lab/plan/load", b"x" * (1 << 21)),
            ("@riot/lab/plan/load?name=\x1b[2J;;;=", b"[[inject]]"),
            ("@riot/lab/intercept/add", b'{"keys": ["' + b"a/" * 5000 + b'"]}'),
            ("@riot/lab/intercept/add", b'{"keys": ["@riot/**"]}'),
            ("@riot/lab/intercept/add", b"[" * 60_000),
            ("@riot/lab/record/start", b'{"path": "../../x.mcap"}'),
            ("@riot/lab/record/start", b'{"path": "/tmp/x.mcap"}'),
            ("@riot/lab/nonsense/**/x", b""),
            ("@riot/lab/status/x", b""),
        ):
            errors = [
                json.loads(reply.err.payload.to_bytes()) for reply in raw(client, key, payload=payload) if reply.err
            ]
            if "*" not in key:
                assert [each["exit_code"] for each in errors] == [2], key
                assert {"message", "where", "hint", "version"} <= errors[0].keys()
        client.put(Message(0, "@riot/lab/plan/clear", b"", qos=BLOCK))
        channels = [client.session.get("@riot/lab/status", timeout=60) for _ in range(300)]
        answers = [reply for channel in channels for reply in channel]
        assert len(answers) == 300  # all are answered, some that there are too many
        assert any(reply.ok for reply in answers)
        status = ask(router.endpoints["system"], "lab", "status")
    assert (status["intercepted"], status["plan"], status["recording"]) == (["cut/**"], None, None)


def test_control_does_not_cross_segments_and_can_be_confined(tmp_path: Path) -> None:
    with RouterProcess("--name=lab", "--control=unit", cwd=tmp_path) as router:
        assert find_routers(router.endpoints["unit"]) == ["lab"]
        with pytest.raises(EnvironmentFaultError, match="no router 'lab' answers"):
            ask(router.endpoints["system"], "lab", "status")


def test_commands_of_the_command_line(router: RouterProcess, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    endpoint = f"--endpoint={router.endpoints['unit']}"
    for arguments, text in (
        (["status"], "router lab, riot_bus"),
        (["counts"], "topic"),
        (["intercept", "add", "/odom", "b"], "intercepted: cut/**, /odom, b"),
        (["intercept", "remove", "/odom"], "intercepted: cut/**, b"),
        (["plan", "load", str(plan)], "plan plan.toml: 1 injection, carried out 0 times"),
        (["plan", "clear"], "no plan"),
        (["record", "start", "x.mcap"], f"recording: {tmp_path / 'x.mcap'}"),
        (["record", "split"], f"recording: {tmp_path / 'x-2.mcap'}"),
        (["record", "stop", "--format=json"], '"lost": 0'),
    ):
        code, out, err = riot("ctl", endpoint, *arguments)
        assert (code, text in out, err) == (0, True, ""), (arguments, out, err)
    code, out, err = riot("ctl", endpoint, "intercept", "remove", "c")
    assert (code, out, "not intercepted on your account" in err) == (2, "", True), err
    assert riot("ctl", "counts", *endpoint.split("=")) == (0, riot("ctl", endpoint, "counts")[1], "")
    code, out, err = riot("ctl", f"--endpoint={free_endpoint()}", "status")
    assert (code, out, "nobody answers" in err, "Traceback" in err) == (4, "", True, False), err
    with open_client(router.endpoints["system"]):
        assert wait_until(
            lambda: (
                "system" in [each["segment"] for each in ask(router.endpoints["unit"], "lab", "graph")["components"]]
            ),
            60,
            interval=0.05,
        )
        for form, text in (("text", "SEGMENT"), ("json", '"version": 1'), ("mermaid", "subgraph"), ("dot", "cluster")):
            code, out, err = riot("graph", endpoint, f"--format={form}")
            assert (code, text in out, err) == (0, True, ""), (form, out, err)


def test_several_routers_in_one_network_are_told_apart_by_name(router: RouterProcess, tmp_path: Path) -> None:
    joined = f"--connect=system={router.endpoints['system']}"
    with RouterProcess("--name=other", joined, cwd=tmp_path) as second:
        endpoint = second.endpoints["system"]
        assert wait_until(lambda: find_routers(endpoint) == ["lab", "other"], 60, interval=0.05)
        with pytest.raises(ConfigError, match="several routers answer: lab, other"):
            ask(endpoint, None, "plan/clear")
        assert ask(endpoint, "lab", "status")["name"] == "lab"


def test_access_control_of_the_docs_lets_one_user_read_and_another_not(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs/router.md").read_text()
    section = text.partition("### Who may control")[2].partition("\n## ")[0]
    block = re.findall(r"(?:^    .*\n|^\n)+", section, re.MULTILINE)
    toml = "\n".join(line[4:] for line in max(block, key=len).splitlines())
    (tmp_path / "riot.toml").write_text(toml.replace("tcp/127.0.0.1:7447", "tcp/127.0.0.1:0"))
    write_private(tmp_path / "users.txt", "alice:wonder\nguest:guest\n")
    with RouterProcess("--name=lab", cwd=tmp_path, segments=False) as router:
        endpoint = router.endpoints["system"]
        users = {
            user: {"transport/auth/usrpwd/user": user, "transport/auth/usrpwd/password": password}
            for user, password in (("alice", "wonder"), ("guest", "guest"))
        }
        assert ask(endpoint, "lab", "status", config=users["alice"])["name"] == "lab"
        assert ask(endpoint, "lab", "intercept/add", keys("a"), config=users["alice"])["intercepted"] == ["a"]
        with open_client(endpoint, config=users["guest"]) as guest:
            for key in ("@riot/lab/status", "@riot/**", "@riot/lab/intercept/remove"):
                got = list(guest.session.get(key, payload=keys("a"), timeout=1, target=zenoh.QueryTarget.ALL))
                assert not [reply for reply in got if reply.ok], key
            forged: Any = guest.session.declare_queryable(
                "@riot/lab/status", lambda query: query.reply("@riot/lab/status", b"{}")
            )
            token: Any = guest.session.liveliness().declare_token("@riot/lab/x")
            for _ in range(5):  # two answers would be an error
                assert ask(endpoint, "lab", "status", config=users["alice"])["intercepted"] == ["a"]
            with open_client(endpoint, config=users["alice"]) as alice:
                assert not list(alice.session.liveliness().get("@riot/lab/x", timeout=1))
            forged.undeclare()
            token.undeclare()
        with pytest.raises(EnvironmentFaultError):  # nobody gets around this by saying no name
            ask(endpoint, "lab", "status")


def test_a_question_that_was_lost_in_a_full_queue_is_asked_again() -> None:
    with RouterProcess("--segment", "a=tcp/127.0.0.1:0", "--segment", "b=tcp/127.0.0.1:0") as router:
        endpoint = router.endpoints["a"]
        with open_client(endpoint) as server, Remote(endpoint, "other") as remote:
            asked: list[str] = []

            def drop_three(query: zenoh.Query) -> None:
                asked.append(str(query.key_expr))
                if len(asked) > 3:
                    query.reply(query.key_expr, json.dumps({"version": 1, "router": "other", "result": {"n": 1}}))

            server.session.declare_queryable("@riot/other/stop", drop_three)
            assert wait_until(lambda: bool(list(remote.client.session.get("@riot/other/stop"))) or bool(asked), 30)
            asked.clear()
            assert remote.ask("stop", timeout=30) == {"n": 1}
            assert asked == ["@riot/other/stop"] * 4
