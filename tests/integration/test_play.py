"""Logs are played to real Zenoh processes."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from riot_bus.play.options import PlayOptions
from riot_bus.play.service import PlayService
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.play_tools import BEGIN, MS, SECOND, Listener, numbered, play, write
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration

PLAN = """
[[inject]]
topic = "a/x"
field = "v"
value = 99
first = 1
last = 1

[[inject]]
topic = "a/y"
fault = "delay"
delay = 0.0035
first = 0
last = 0
"""

EXTRA = """
class Extra:
    topics = "a/x"

    def message(self, event):
        if event.index == 3:
            event.drop()
"""


@pytest.fixture
def router() -> Iterator[str]:
    with ZenohProcess("router") as process:
        yield process.locators[0]


def test_plays_everything_as_it_was_recorded(router: str, tmp_path: Path) -> None:
    log = [
        Message(BEGIN, "a/x", b"1", encoding="application/json", attachment=b"att", qos=Qos(2, "block", express=True)),
        Message(BEGIN + MS, "a/y", b"\0\xff", encoding="application/json;odd", qos=Qos(7)),
        Message(BEGIN + 2 * MS, "a/x", b"", kind="delete", qos=Qos(2, "block", express=True), attachment=b"gone"),
        Message(BEGIN + 3 * MS, "a/x", b"", qos=Qos(1, "block")),
    ]
    with Listener(router, "a/**") as listener:
        result = play(router, write(tmp_path / "log.mcap", log))
        found = listener.wait(4)
    found.sort(key=Message.digest)  # a higher priority may overtake
    for sent, received in zip(sorted(log, key=Message.digest), found, strict=True):
        assert received == sent.with_(time=received.time, sequence=received.sequence)
    assert result
    assert (result.published, result.passes, result.stopped) == (4, 1, False)


def test_many_plays_arrive_in_the_identical_order(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(200, *[f"a/{key}" for key in "xyzuv"]))
    expected = [b'{"v": %d}' % number for number in range(200)]
    with Listener(router, "a/*") as listener:
        for number in range(20):
            result = play(router, log, rate=0.0 if number % 2 else 50.0, control=False)
            assert listener.payloads(200) == expected, number
            assert result, result
            listener.clear()


def test_several_logs_are_merged_by_time_and_on_equal_times_by_their_order(router: str, tmp_path: Path) -> None:
    first = write(tmp_path / "first.mcap", numbered(20, "a/x", period=2 * MS))
    second = write(tmp_path / "second.mcap", numbered(20, "b/x", period=3 * MS, begin=BEGIN + 4 * MS))
    expected = sorted(
        [(2 * number, 0, number) for number in range(20)] + [(4 + 3 * number, 1, number) for number in range(20)]
    )
    with Listener(router, "*/x") as listener:
        play(router, first, second, rate=0.0)
        found = [(m.key, m.payload) for m in listener.wait(40)]
        assert found == [("ab"[log] + "/x", b'{"v": %d}' % number) for _, log, number in expected]
        listener.clear()
        play(router, first, second, rate=0.0, align=True, duration=0.0061)
        assert "".join(m.key[0] for m in listener.wait(7)) == "ababaab"


@pytest.mark.parametrize(
    ("options", "numbers"),
    [
        ({"start_offset": 0.0025}, range(3, 10)),
        ({"duration": 0.003}, range(3)),
        ({"start_offset": 0.002, "duration": 0.003}, range(2, 5)),
        ({"until": "0.004"}, range(4)),
        ({"until": f"{BEGIN / 1e9 + 0.0045:.4f}"}, range(5)),
        ({"until": "2023-11-14T22:13:20.0035"}, range(4)),
    ],
)
def test_parts_of_a_log(router: str, tmp_path: Path, options: dict[str, float], numbers: range) -> None:
    log = write(tmp_path / "log.mcap", numbered(10, "a/x"))
    with Listener(router, "a/*") as listener:
        assert play(router, log, **options).published == len(numbers)
        assert listener.payloads(len(numbers)) == [b'{"v": %d}' % number for number in numbers]


def test_selection_and_other_names(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(4, "a/x", "a/y", "b/x/z", "c"))
    with Listener(router, "**") as listener:
        play(router, log, topics=["a/*", "/b/**"], exclude=["a/y"], remap=["a/x:=new/x", "b/**:=d/e/**"])
        assert [(m.key, m.payload) for m in listener.wait(2)] == [("new/x", b'{"v": 0}'), ("d/e/x/z", b'{"v": 2}')]


def test_loop_delay_and_stop(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(3, "a/x"))
    options = PlayOptions(logs=[log], endpoint=router, loop=True, delay=0.02, wait=20.0)
    with Listener(router, "a/*") as listener, PlayService(options) as service:
        assert len(listener.wait(9)) >= 9
        service.stop()
        assert service.wait(20)
        result = service.result()
        payloads = listener.payloads(result.published)
    assert payloads[:9] == [b'{"v": %d}' % (number % 3) for number in range(9)]
    assert result.stopped
    assert result.passes >= 3


def test_the_first_message_waits_for_subscribers(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(20, "a/x", "a/y"))
    options = PlayOptions(logs=[log], endpoint=router, wait=60.0, rate=0.0)
    with PlayService(options) as service, Listener(router, "a/x") as listener:
        assert wait_until(lambda: service._publishing.unmatched() == ["a/y"], 60)
        assert service.status()["state"] == "waiting"
        assert not service.wait(0.1)
        assert listener.messages == []
        listener.client.subscribe("a/y", listener._take)
        assert sorted(listener.payloads(20)) == sorted(b'{"v": %d}' % number for number in range(20))


def test_without_subscribers_it_goes_on_and_says_so(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(7, *[f"a/{key}" for key in range(7)]))
    warnings: list[str] = []
    result = play(router, log, wait=0.05, warn=warnings.append)
    assert (result.published, bool(result)) == (7, True)
    assert warnings == ["after 0.05 s there is no subscriber to a/0, a/1, a/2, a/3, a/4 and 2 more"]


def test_a_live_publisher_is_told_of(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(400, "a/x", "a/y", "a/z", period=2 * MS))
    warnings: list[str] = []
    with Listener(router, "a/*"), Puppet(router) as puppet:
        puppet.do("publish_advanced", key="a/y", payloads=[])
        puppet.do("stream", key="a/x", interval=0.01)
        play(router, log, warn=warnings.append)
    assert len(warnings) == 2
    assert f"session {puppet.zid} publishes a/y already" in "".join(warnings)
    assert "another publisher publishes a/x already: subscribers get both; leave it out (--exclude a/x)" in "".join(
        warnings
    )


def test_injections_apply_while_playing(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(10, "a/x", "a/y"))
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    interceptor = tmp_path / "extra.py"
    interceptor.write_text(EXTRA)
    with Listener(router, "a/*") as listener:
        play(router, log, inject=plan, interceptors=[str(interceptor)])
        found = [m.payload for m in listener.wait(9)]
    expected = [0, 99, 3, 4, 5, 7, 1, 8, 9]  # 1 is 3.5 ms late
    assert found == [b'{"v": %d}' % number for number in expected]


def test_a_plan_for_other_topics_is_odd(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(2, "a/x"))
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    warnings: list[str] = []
    with Listener(router, "a/*"):
        play(router, log, inject=plan, warn=warnings.append)
    assert warnings == ["nothing is played on 'a/y', which an interceptor wants; did you mean 'a/x'?"]


class Echo:
    """A component that needs its time for each message, and then answers."""

    def __init__(self, endpoint: str, answers: int) -> None:
        self.client = open_client(endpoint)
        self.before: list[int] = []
        """How many messages had been answered when one came."""
        self.answered = 0
        self._answers = answers
        self._threads: list[threading.Timer] = []
        self.client.subscribe("a/x", self._take)

    def _take(self, message: Message) -> None:
        self.before.append(self.answered)
        timer = threading.Timer(0.01, self._answer)
        self._threads.append(timer)
        timer.start()

    def _answer(self) -> None:
        for number in range(self._answers):
            self.answered += number == self._answers - 1  # first: the next message may come before `put` returns
            self.client.put(Message(0, f"out/{number}", b""))

    def close(self) -> None:
        for each in self._threads:
            each.join()
        self.client.close()


def test_lock_step_by_acknowledgement(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(30, "a/x"))
    echo = Echo(router, 1)
    result = play(router, log, ack="out/0", settle_timeout=30.0)
    echo.close()
    assert echo.before == list(range(30))
    assert (result.unsettled, result.published) == (0, 30)


def test_lock_step_by_quiet_outputs(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(5, "a/x"))
    echo = Echo(router, 3)
    result = play(router, log, rate=0.0, lockstep=["out/**"], quiet=0.5, settle_timeout=30.0)
    echo.close()
    assert echo.before == list(range(5))
    assert result.unsettled == 0


def test_who_never_settles_is_counted_and_left_behind(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(3, "a/x"))
    with Listener(router, "a/x") as listener:
        result = play(router, log, ack="out/0", settle_timeout=0.05)
        assert len(listener.wait(3)) == 3
    assert result.unsettled == 3


def test_commands_steer_a_running_player(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(10, "a/x", period=10 * SECOND))
    options = PlayOptions(logs=[log], endpoint=router, paused=True, wait=20.0)
    with Listener(router, "a/*") as listener, PlayService(options) as service:
        service.step(2)
        assert listener.payloads(2) == [b'{"v": 0}', b'{"v": 1}']
        service.seek(75.0)
        assert service.status()["position"] == 75.0
        service.set_rate(0.0)
        service.resume()
        assert listener.payloads(4) == [b'{"v": %d}' % number for number in (0, 1, 8, 9)]
        assert service.wait(20)
        assert service.status()["state"] == "ended"


def test_a_second_player_gets_a_name_of_its_own(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(2, "a/x"))
    options = PlayOptions(logs=[log], endpoint=router, paused=True)
    warnings: list[str] = []
    with PlayService(options) as first, PlayService(options, warn=warnings.append) as second:
        assert (first.name, second.name) == ("player", "player-2")


def test_what_is_published_into_the_void_is_counted(tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(1000, "a/x"))
    with ZenohProcess("router") as process, Listener(process.locators[0], "a/*") as listener:
        options = PlayOptions(logs=[log], endpoint=process.locators[0], wait=20.0, rate=1.0)
        with PlayService(options) as service:
            listener.wait(10)
            process.close()
            assert service.wait(60)
            result = service.result()
    assert result.published == 1000
    assert result.lost["a/x"] > 0
    assert result.problems["link"].endswith("broke 1 times")
    assert not result


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"topics": ["a/w"]}, "no topic 'a/w'"),
        ({"remap": ["a/w:=b"]}, "no topic 'a/w'"),
        ({"remap": ["a/x"]}, "does not say what to rename"),
        ({"remap": ["a/x:=b/*"]}, "cannot be published"),
        ({"exclude": ["a/x"]}, "nothing is left to play"),
        ({"rate": -1.0}, "not a speed"),
        ({"start_offset": 9.0}, "the logs are 0.009 s long"),
        ({"until": "yesterday"}, "is no time"),
        ({"until": "0"}, "not after the beginning"),
        ({"until": "1", "duration": 1.0}, "both say"),
        ({"ack": "a", "lockstep": ["b"]}, "both say"),
        ({"name": "a/b"}, "is not a name"),
        ({"interceptors": ["no_such"]}, "unknown interceptor 'no_such'"),
        ({"latched": ["a/x=0"]}, "what to latch"),
    ],
)
def test_bad_options_are_one_clear_error(tmp_path: Path, options: dict[str, object], message: str) -> None:
    log = write(tmp_path / "log.mcap", numbered(10, "a/x"))
    with pytest.raises(ConfigError, match=message):
        PlayService(PlayOptions(logs=[log], **options))  # type: ignore[arg-type]


def test_nobody_at_the_endpoint(tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(10, "a/x"))
    with pytest.raises(EnvironmentFaultError, match="nobody answers"):
        play("tcp/127.0.0.1:1", log)


def test_an_empty_log_is_played_at_once(router: str, tmp_path: Path) -> None:
    result = play(router, write(tmp_path / "log.mcap", []))
    assert (result.published, bool(result)) == (0, True)


def test_a_topic_that_has_lost_its_subscriber_is_named(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(10, "a/x", "a/y"))
    warnings: list[str] = []
    options = PlayOptions(logs=[log], endpoint=router, wait=20.0, rate=0.0, ack="go", settle_timeout=60.0)
    with (
        Listener(router, "a/x") as listener,
        Listener(router, "a/y") as other,
        PlayService(options, warn=warnings.append) as service,
    ):
        listener.wait(1)
        other.client.close()
        assert wait_until(lambda: service._publishing.unmatched() == ["a/y"], 60)
        while not service.wait(0.01):
            listener.client.put(Message(0, "go", b""))
    assert warnings == ["at the end there is no longer a subscriber to a/y"]
