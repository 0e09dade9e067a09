"""Requests and replies of selected services go through the pipeline; callers and services do not notice."""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from riot_bus.config.router_settings import RouterSettings
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import merged
from riot_bus.control.router_service import RouterService
from riot_bus.interceptors.copies import Tee
from riot_bus.interceptors.recorder import Recorder
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.pipeline.event import Event
from riot_bus.router.bus import Bus
from riot_bus.router.services.forwarder import Limits
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.types.serve import Request
from riot_bus.zenoh.client import Client, open_client
from riot_bus.zenoh.session import release, wait_until
from riot_bus_conformance.run import PLAIN, compare, run_scenario
from riot_bus_conformance.scenario import PREFIX, find
from tests.integration.bus_puppet import Puppet
from tests.integration.service_tools import (
    ADD,
    SEGMENTS,
    Parallel,
    Script,
    Server,
    balance,
    call,
    elapsed,
    eventually,
    pipeline,
    present,
    two,
)

pytestmark = pytest.mark.integration

HASH = "RIHS01_" + "0" * 64
ACTION = {
    "send_goal": f"0/fibonacci/_action/send_goal/example_interfaces::action::dds_::Fibonacci_SendGoal_/{HASH}",
    "get_result": f"0/fibonacci/_action/get_result/example_interfaces::action::dds_::Fibonacci_GetResult_/{HASH}",
    "cancel_goal": f"0/fibonacci/_action/cancel_goal/action_msgs::srv::dds_::CancelGoal_/{HASH}",
    "feedback": f"0/fibonacci/_action/feedback/example_interfaces::action::dds_::Fibonacci_FeedbackMessage_/{HASH}",
    "status": f"0/fibonacci/_action/status/action_msgs::msg::dds_::GoalStatusArray_/{HASH}",
}
REQUEST, REPLY, ERROR = (f"{ADD}/{part}" for part in ("@request", "@reply", "@error"))


# -- as without riot --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "services"),
    [
        ("many_replies", "**"),
        ("query_errors", "**"),
        ("query_contents", "**"),
        ("query_quality", "**"),
        ("consolidation", "**"),
        ("consolidation", "q"),
        ("queriers", "q"),
    ],
)
def test_callers_and_services_see_what_they_see_without_riot(name: str, services: str) -> None:
    scenario = find(name)
    plain = run_scenario(scenario, PLAIN)
    with Bus({"left": (), "right": ()}, services=[f"{PREFIX}/{name}/{services}"]) as bus:
        other = run_scenario(scenario, "services", (bus.endpoint("left"), bus.endpoint("right")))
        balance(bus)
        assert not bus.losses
    assert [str(each) for each in compare([plain, other])] == []


def test_of_targets_only_those_differ_that_a_router_cannot_see() -> None:
    scenario = find("query_targets")
    plain = run_scenario(scenario, PLAIN)
    with Bus({"left": (), "right": ()}, services=[f"{PREFIX}/query_targets/**"]) as bus:
        other = run_scenario(scenario, "services", (bus.endpoint("left"), bus.endpoint("right")))
    differences = compare([plain, other])
    # A partial service beside a complete one; complete ones below a selection with wildcards (docs/router.md).
    assert {each.place for each in differences} == {
        "left.ALL one",
        "left.ALL_COMPLETE one",
        "left.ALL_COMPLETE three",
    }


def test_what_is_not_selected_passes_natively_also_on_intercepted_keys() -> None:
    with Bus(SEGMENTS, intercept=["calc/**"], services=["other"]) as bus, two(bus) as (system, unit):
        Server(unit)
        present(system)
        assert call(system) == [("put", "x!")]
        assert bus.counts() == {}


def test_a_selected_service_does_not_disturb_topics_of_the_same_key() -> None:
    with Bus(SEGMENTS, services=["calc/**"]) as bus, two(bus) as (system, unit):
        got: list[bytes] = []
        unit.subscribe("calc/**", lambda message: got.append(message.payload))
        assert bus.wait_subscribed("unit", ["calc/topic"], timeout=60) == []

        def crossed() -> bool:
            system.session.put("calc/topic", "hello")
            return bool(got)

        assert wait_until(crossed, 60, interval=0.02)
        assert bus.counts() == {}


def test_services_in_several_segments_and_the_callers_own_are_each_asked_once() -> None:
    segments: dict[str, list[str]] = {"a": [], "b": [], "c": []}
    with Bus(segments, services=["calc/**"]) as bus:
        clients = {name: open_client(bus.endpoint(name)) for name in segments}
        servers = {name: Server(client, reply=_named(name), complete=False) for name, client in clients.items()}
        for client in clients.values():
            present(client, complete=False)
        for number, client in enumerate(clients.values(), 1):

            def all_three(client: Any = client) -> bool:
                return sorted(text for _, text in call(client)) == ["a", "b", "c"]

            assert wait_until(all_three, 60)
            assert all(len(server.asked) >= number for server in servers.values())
        before = {name: len(server.asked) for name, server in servers.items()}
        assert len(call(clients["a"])) == 3
        assert {name: len(server.asked) - before[name] for name, server in servers.items()} == dict.fromkeys("abc", 1)
        balance(bus)
        for client in clients.values():
            client.close()


def _named(name: str) -> Any:
    return lambda query: query.reply(query.key_expr, name)


def test_calls_within_a_segment_are_not_intercepted_and_calls_of_nobody_end_at_once() -> None:
    with Bus(SEGMENTS, services=["calc/**"]) as bus, two(bus) as (system, unit):
        server = Server(system, complete=False)
        present(unit, complete=False)
        assert eventually(unit) == [("put", "x!")]
        served = len(server.asked)
        known = bus.counts()[REQUEST].received
        assert eventually(system) == [("put", "x!")]
        assert len(server.asked) >= served + 1
        assert call(unit, key="calc/nobody", timeout=60) == []
        balance(bus)
        assert bus.counts()[REQUEST].received == known
        assert "calc/nobody/@request" not in bus.counts()


# -- coming and going -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("complete", [True, False])
def test_a_service_appears_and_leaves_on_the_other_side(*, complete: bool) -> None:
    with Bus(SEGMENTS, services=[ADD]) as bus, two(bus) as (system, unit):
        present(system, there=False, complete=complete)
        assert call(system, timeout=60) == []
        for _ in range(3):
            server = Server(unit, complete=complete)
            present(system, complete=complete)
            assert complete or not _is_complete(system)
            assert call(system) == [("put", "x!")]
            server.leave()
            present(system, there=False, complete=complete)
            assert call(system, timeout=60) == []
        assert balance(bus)[REQUEST].received == 3


def _is_complete(client: Any) -> bool:
    querier = client.session.declare_querier(ADD, target=zenoh.QueryTarget.ALL_COMPLETE)
    found = bool(querier.matching_status.matching)
    querier.undeclare()
    return found


def test_callers_hear_the_end_when_a_service_is_killed_and_its_successor_answers() -> None:
    with Bus(SEGMENTS, services=[ADD]) as bus, two(bus) as (system, _):
        with Puppet(bus.endpoint("unit")) as first:
            first.do("queryable", key=ADD)
            present(system, complete=False)
            assert call(system) == [("put", "x")]
            first.pause()
            parallel = Parallel(system)
            parallel.start(1)
            assert wait_until(lambda: bus.counts()[REQUEST].forwarded == 2, 60)
            first.kill()
        assert parallel.wait(1)
        assert parallel.found == {1: []}
        present(system, there=False, complete=False)
        with Puppet(bus.endpoint("unit")) as second:
            second.do("queryable", key=ADD)
            present(system, complete=False)
            assert call(system, "y") == [("put", "y")]
        balance(bus)


def test_callers_that_are_killed_disturb_nobody() -> None:
    with Bus(SEGMENTS, services=[ADD]) as bus, two(bus) as (system, unit):
        server = Server(unit, silent=True)
        present(system)
        with Puppet(bus.endpoint("system")) as caller:
            caller.start("get", key=ADD)
            assert wait_until(lambda: len(server.kept) == 1, 60)
            caller.kill()
        parallel = Parallel(system)
        parallel.start(1)
        assert wait_until(lambda: len(server.kept) == 2, 60)
        for query in server.kept:
            with query:
                query.reply(ADD, "late")
        assert parallel.wait(1)
        assert parallel.found == {1: [("put", "late")]}
        counts = balance(bus)
        assert (counts[REQUEST].received, counts[REPLY].received) == (2, 2)


def test_selection_changes_while_the_router_runs() -> None:
    with Bus(SEGMENTS, services=["calc/kept"]) as bus, two(bus) as (system, unit):
        Server(unit), Server(unit, "calc/kept")
        for key in (ADD, "calc/kept"):
            present(system, key)
            assert call(system, key=key) == [("put", "x!")]
        assert set(bus.counts()) == {"calc/kept/@request", "calc/kept/@reply"}
        bus.set_intercept([], services=["calc/kept", ADD])
        assert eventually(system) == [("put", "x!")]
        assert wait_until(lambda: REPLY in bus.counts(), 60)
        seen = bus.counts()[REQUEST].received
        assert call(system) == [("put", "x!")]
        assert bus.counts()[REQUEST].received == seen + 1
        bus.set_intercept([], services=["calc/kept"])
        assert eventually(system) == [("put", "x!")]
        assert call(system, key="calc/kept") == [("put", "x!")]
        counts = balance(bus)
        assert counts[REQUEST].received == seen + 1
        assert counts["calc/kept/@request"].received == 2


# -- interceptors -----------------------------------------------------------------------------------------------------


def test_interceptors_change_delay_copy_and_replace_requests_and_replies() -> None:
    script = Script()
    with Bus(SEGMENTS, services=["calc/**"], pipeline=pipeline(script)) as bus, two(bus) as (system, unit):
        server = Server(unit, complete=False)
        other = Server(unit, "calc/sub", lambda query: query.reply("calc/sub", "sub"), complete=False)
        present(system, complete=False)
        everywhere = {"accept_replies": zenoh.ReplyKeyExpr.ANY}
        assert eventually(system, "same") == [("put", "same!")]
        assert call(system, "change me") == [("put", "changed!")]
        assert call(system, "change reply") == [("put", "changed")]
        assert call(system, "twice") == [("put", "twice!")] * 2
        assert call(system, "twice reply") == [("put", "twice reply!")] * 2
        assert call(system, "fail") == [("error", "broken")]
        assert call(system, "raise") == [("put", "raise!")]
        assert call(system, "elsewhere", **everywhere) == [("put", "sub")]
        asked = len(server.asked)
        assert call(system, "forge") == [("put", "forged")]
        assert len(server.asked) == asked
        for text in ("late", "late reply"):
            seconds, found = elapsed(lambda text=text: call(system, text))  # type: ignore[misc]
            assert found == [("put", f"{text}!")]
            assert seconds >= 0.2
        assert [payload for payload, _ in other.asked] == ["elsewhere"]
        counts = balance(bus)
        requests, replies = counts[REQUEST], counts[REPLY]
        assert (requests.dropped, requests.changed, requests.held) == (1, 2, 0)
        assert (replies.changed, replies.added, replies.lost) == (2, 2, 0)
        assert script.seen[0] == (REQUEST, "same", "system", ("unit",))
        assert script.seen[1] == (REPLY, "same!", "unit", ("system",))
        assert bus.executor.pipeline.errors["Script"].count == 1


@pytest.mark.parametrize("text", ["drop me", "drop reply"])
def test_a_caller_waits_for_what_was_dropped_until_its_time_is_up(text: str) -> None:
    with Bus(SEGMENTS, services=[ADD], pipeline=pipeline(Script())) as bus, two(bus) as (system, unit):
        server = Server(unit)
        present(system)
        seconds, found = elapsed(lambda: call(system, text, timeout=0.7))
        assert {kind for kind, _ in found} <= {"error"}  # Zenoh's own; each router on the way may time out as well
        assert seconds >= 0.65
        assert call(system, "next") == [("put", "next!")]
        assert [payload for payload, _ in server.asked] == (["next"] if text == "drop me" else [text, "next"])
        counts = balance(bus)
        assert counts[REQUEST].dropped + counts[REPLY].dropped == 1


@pytest.mark.parametrize(("limit", "value"), [("silent", 0), ("silent_s", 0.1)])
def test_who_waits_for_what_was_dropped_waits_within_limits(
    monkeypatch: pytest.MonkeyPatch, limit: str, value: float
) -> None:
    monkeypatch.setattr(Limits, limit, value)
    with Bus(SEGMENTS, services=[ADD], pipeline=pipeline(Script())) as bus, two(bus) as (system, unit):
        server = Server(unit)
        present(system)
        for _ in range(3):
            assert call(system, "drop me", timeout=60) == []
        assert server.asked == []
        assert balance(bus)[REQUEST].dropped == 3


def test_an_interceptor_can_publish_because_of_a_request() -> None:
    with Bus(SEGMENTS, services=[ADD], pipeline=pipeline(Script())) as bus, two(bus) as (system, unit):
        got: list[bytes] = []
        unit.subscribe("told", lambda message: got.append(message.payload))
        Server(unit)
        present(system)
        assert bus.wait_subscribed("system", ["told"], timeout=60) == []
        assert call(system, "tell") == [("put", "tell!")]
        assert wait_until(lambda: got == [b"told"], 60)
        assert balance(bus)["told"].added == 1


def test_tee_copies_requests_and_calls_nobody() -> None:
    tees = pipeline(Tee("{key}"), Tee("copy/{key}"), Tee("copy/{key}/seen"))
    with Bus(SEGMENTS, services=["calc/**", "copy/**"], pipeline=tees) as bus, two(bus) as (system, unit):
        got: list[bytes] = []
        unit.subscribe(f"copy/{REQUEST}/seen", lambda message: got.append(message.payload))
        servers = [Server(unit, key) for key in (ADD, f"copy/{ADD}")]
        present(system, complete=False)
        assert bus.wait_subscribed("system", [f"copy/{REQUEST}/seen"], timeout=60) == []
        assert call(system, "once") == [("put", "once!")]
        assert [[payload for payload, _ in each.asked] for each in servers] == [["once"], []]
        assert wait_until(lambda: got == [b"once"], 60)
        assert balance(bus)[REQUEST].forwarded == 1


def test_an_interceptor_that_does_not_come_back_is_bypassed_and_the_call_goes_on() -> None:
    class Hangs:
        def __init__(self) -> None:
            self.go_on = threading.Event()

        def message(self, event: Event) -> None:
            self.go_on.wait(30)

    hangs = Hangs()
    with Bus(SEGMENTS, services=[ADD], pipeline=pipeline(hangs), budget_s=0.2) as bus, two(bus) as (system, unit):
        server = Server(unit)
        present(system)
        assert call(system, "a") == [("put", "a!")]
        assert call(system, "b") == [("put", "b!")]
        assert [payload for payload, _ in server.asked] == ["a", "b"]
        counts = balance(bus)
        assert (counts[REQUEST].received, counts[REPLY].received) == (2, 2)
        hangs.go_on.set()


def test_parameters_can_be_seen_and_changed() -> None:
    class Double:
        def message(self, event: Event) -> None:
            if isinstance(event.message, Request):
                event.message = event.message.with_(parameters=f"{event.message.parameters};b=2")

    with Bus(SEGMENTS, services=[ADD], pipeline=pipeline(Double())) as bus, two(bus) as (system, unit):
        server = Server(unit)
        present(system)
        assert call(system, key=f"{ADD}?a=1") == [("put", "x!")]
        assert server.asked == [("x", "a=1;b=2")]


def test_source_information_of_calls_is_left_out_and_timestamps_of_replies_are_kept() -> None:
    sources: list[Any] = []
    stamps: list[Any] = []

    with Bus(SEGMENTS, services=[ADD]) as bus, two(bus) as (system, unit):

        def reply(query: Any) -> None:
            sources.append(query.source_info)
            stamps.append(unit.session.new_timestamp())
            query.reply(query.key_expr, "", timestamp=stamps[-1])

        Server(unit, reply=reply)
        present(system)
        sources.clear()
        publisher = system.session.declare_publisher("own")
        found = list(system.session.get(ADD, source_info=zenoh.SourceInfo(publisher.id, 7), timeout=60.0))
    assert sources == [None]  # docs/router.md says so
    [stamp] = [each.ok.timestamp for each in found if each.ok is not None]
    assert stamp is not None
    assert stamp.get_id() == stamps[-1].get_id()
    assert 0 <= stamps[-1].get_time_as_ntp64().as_nanos() - stamp.get_time_as_ntp64().as_nanos() <= 1


# -- many, and for ever -----------------------------------------------------------------------------------------------


def test_a_thousand_parallel_calls_each_get_their_own_reply() -> None:
    count = 1000
    with Bus(SEGMENTS, services=[ADD]) as bus, two(bus) as (system, unit):
        server = Server(unit)
        present(system)
        parallel = Parallel(system)
        for number in range(count):
            parallel.start(number)
        assert parallel.wait(count)
        assert parallel.found == {number: [("put", f"{number}!")] for number in range(count)}
        assert len(server.asked) == count
        counts = balance(bus)
        assert (counts[REQUEST].forwarded, counts[REPLY].forwarded) == (count, count)
        assert not bus.losses


def test_of_calls_that_never_end_the_oldest_are_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Limits, "calls", 3)
    with Bus(SEGMENTS, services=[ADD]) as bus, two(bus) as (system, unit):
        server = Server(unit, silent=True)
        present(system)
        parallel = Parallel(system)
        for number in range(5):
            parallel.start(number)
        assert parallel.wait(2)
        assert sorted(parallel.found) == [0, 1]
        assert wait_until(lambda: len(server.kept) == 5, 60)
        for query in server.kept:
            with query:
                query.reply(ADD, "late")
        assert parallel.wait(5)
        assert [parallel.found[number] for number in range(5)] == [[], [], *[[("put", "late")]] * 3]
        balance(bus)


def test_what_there_is_no_room_for_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Limits, "queued", 0)
    with Bus(SEGMENTS, services=[ADD]) as bus, two(bus) as (system, unit):
        Server(unit)
        present(system)
        assert call(system, timeout=60) == []
        counts = balance(bus)
        assert (counts[REQUEST].received, counts[REQUEST].lost) == (1, 1)
        assert bus.losses.reasons == {"no room": 1}


def test_what_is_still_delayed_at_the_end_is_lost_and_counted() -> None:
    class Late:
        def message(self, event: Event) -> None:
            event.delay(1000)

    with Bus(SEGMENTS, services=[ADD], pipeline=pipeline(Late())) as bus, two(bus) as (system, unit):
        Server(unit)
        present(system)
        parallel = Parallel(system)
        parallel.start(1)
        assert wait_until(lambda: bus.counts()[REQUEST].held == 1 if REQUEST in bus.counts() else False, 60)
    assert bus.counts()[REQUEST].held == 0
    assert bus.counts()[REQUEST].lost == 1
    assert bus.losses.reasons == {"held at the end": 1}


# -- logs -------------------------------------------------------------------------------------------------------------


def test_requests_and_replies_are_recorded_and_belong_together(tmp_path: Path) -> None:
    path = tmp_path / "calls.mcap"

    def several(query: Any) -> None:
        query.reply(ADD, "change reply")
        query.reply_del(ADD)
        query.reply_err("no", encoding="text/plain")

    recorder = Recorder(LogWriter(path))
    with Bus(SEGMENTS, services=[ADD], pipeline=pipeline(Script()), recorder=recorder) as bus, two(bus) as ends:
        system, unit = ends
        Server(unit, reply=several)
        present(system)
        for number in range(2):
            found = call(system, f"ask {number}", key=f"{ADD}?n={number}", attachment=b"\1\2", encoding="text/plain")
            assert found == [("put", "changed"), ("delete", ""), ("error", "no")]
        balance(bus)
    recorder.close()
    with LogReader(path) as reader:
        assert not reader.loss
        assert {source.topic for source in reader.sources().values()} == {REQUEST, REPLY, ERROR}
        messages = list(reader.messages())
        originals = list(reader.originals())
        changes = list(reader.provenance())
    requests = [each for each in messages if each.key == REQUEST]
    assert [(each.payload, each.attachment, each.encoding, each.segment) for each in requests] == [
        (f"ask {number}".encode(), b"\1\2", "text/plain", "system") for number in range(2)
    ]
    assert [isinstance(each, Request) and each.parameters for each in requests] == ["n=0", "n=1"]
    for number, request in enumerate(requests):
        parts = [(each.key, each.kind, each.payload) for each in messages if each.sequence == request.sequence]
        assert parts == [
            (REQUEST, "put", f"ask {number}".encode()),
            (REPLY, "put", b"changed"),
            (REPLY, "delete", b""),
            (ERROR, "put", b"no"),
        ]
    assert [(each.key, each.payload) for each in originals] == [(REPLY, b"change reply")] * 2
    assert {each.sequence for each in changes} == {each.sequence for each in requests}
    times = [each.time for each in messages]
    assert all(earlier <= later for earlier, later in itertools.pairwise(times))


# -- riot router ------------------------------------------------------------------------------------------------------

FREE = ("system=tcp/127.0.0.1:0", "unit=tcp/127.0.0.1:0")


def service(folder: Path, **flags: Any) -> RouterService:
    settings = merged(RouterSettings(), RouterOptions(segments=FREE, **flags))
    return RouterService(settings, registry=TypeRegistry(load_adapters(["ros2"])), folder=folder, scouting=None)


@contextlib.contextmanager
def joined(router: RouterService) -> Iterator[tuple[Client, Client]]:
    ends = router.endpoints
    with open_client(ends["system"][0]) as system, open_client(ends["unit"][0]) as unit:
        yield system, unit


def test_an_action_is_intercepted_as_a_whole(tmp_path: Path) -> None:
    with service(tmp_path, services=["/fibonacci"]) as router, joined(router) as (system, unit):
        ros = {"target": zenoh.QueryTarget.ALL_COMPLETE, "attachment": bytes(33)}
        got: list[str] = []
        system.subscribe("0/fibonacci/_action/*/*/*", lambda message: got.append(message.key))
        for name in ("send_goal", "get_result", "cancel_goal"):
            Server(unit, ACTION[name])
            assert eventually(system, "x", ACTION[name], **ros) == [("put", "x!")]
        for name in ("feedback", "status"):

            def crossed(key: str = ACTION[name]) -> bool:
                unit.session.put(key, b"")
                return key in got

            assert wait_until(crossed, 60, interval=0.02)
        parts = [f"/fibonacci/_action/{name}/@{part}" for name in list(ACTION)[:3] for part in ("request", "reply")]
        topics = [f"/fibonacci/_action/{name}" for name in ("feedback", "status")]
        assert sorted(router.bus.counts()) == sorted([*parts, *topics])
        assert {router.bus.counts()[part].forwarded for part in parts} == {1}


def test_services_are_selected_and_left_alone_while_the_router_runs(tmp_path: Path) -> None:
    with service(tmp_path, intercept=["odom"]) as router, joined(router) as (system, unit):
        Server(unit)
        assert router.intercept_add(["calc/add/@request"]) == ["odom", "calc/add/@request"]
        assert router.status()["services"] == [ADD]
        assert eventually(system) == [("put", "x!")]
        assert router.bus.counts()[REQUEST].forwarded >= 1
        plan = router.plan_load('[[inject]]\ntopic = "calc/*/@reply"\nfield = "v"\nvalue = 1\n', "plan")
        assert plan["intercepted"] == ["odom", "calc/add/@request", "calc/*/@request"]
        router.plan_clear()
        assert router.intercept_remove(["calc/add/@request"]) == ["odom"]
        assert router.status()["services"] == []
        seen = router.bus.counts()[REQUEST].received
        assert eventually(system) == [("put", "x!")]
        assert router.bus.counts()[REQUEST].received == seen


def test_the_graph_says_which_services_are_intercepted(tmp_path: Path) -> None:
    kind = "example_interfaces::srv::dds_::AddTwoInts_/RIHS01_00"
    with service(tmp_path, intercept=["**"]) as router, joined(router) as (_, unit):
        router.watch()
        zid = unit.session.info.zid()
        tokens = [
            unit.session.liveliness().declare_token(f"@ros2_lv/0/{zid}/0/9/SS/%/%/adder/%{name}/{kind}/::,10:,:,:,,")
            for name in ("add", "other")
        ]

        def marked(**expected: bool) -> bool:
            def found() -> dict[str, bool]:
                return {topic.name: topic.intercepted for topic in router.graph().topics}

            return wait_until(lambda: found() == {f"/{name}": cut for name, cut in expected.items()}, 60, interval=0.05)

        assert marked(add=False, other=False)
        router.intercept_add(["/add/@request"])
        assert marked(add=True, other=False)
        router.intercept_add(["/**/@request"])
        assert marked(add=True, other=True)
        release(*tokens)


def test_who_selects_all_keys_selects_services_of_ros_too(tmp_path: Path) -> None:
    with service(tmp_path, services=["**"]) as router, joined(router) as (system, unit):
        complete = zenoh.QueryTarget.ALL_COMPLETE
        Server(unit, ACTION["send_goal"])
        Server(unit, complete=False)
        assert eventually(system, "x", ACTION["send_goal"], target=complete) == [("put", "x!")]
        assert call(system, "y", ACTION["send_goal"]) == [("put", "y!")]
        assert eventually(system) == [("put", "x!")]
        assert router.bus.counts()["/fibonacci/_action/send_goal/@request"].received == 2


def test_wider_services_and_wider_questions_are_answered_once() -> None:
    with Bus(SEGMENTS, services=["calc/**"]) as bus, two(bus) as (system, unit):
        store = Server(unit, "**", lambda query: query.reply("calc/stored", "stored"), complete=False)
        Server(unit, reply=lambda query: query.reply(ADD, "add"), complete=False)
        Server(unit, "free/x", lambda query: query.reply("free/x", "free"), complete=False)
        wanted = [("put", "add"), ("put", "free"), ("put", "stored")]
        anything = {"target": zenoh.QueryTarget.ALL}

        def all_there() -> bool:
            return sorted(call(system, None, "**", **anything)) == wanted

        assert wait_until(all_there, 60)
        assert sorted(call(system, None, "calc/*")) == [("put", "add"), ("put", "stored")]
        assert call(system, None, "free/x", timeout=60) == [("put", "free")]
        store.leave()
        assert wait_until(lambda: call(system, None, "calc/*") == [("put", "add")], 60)
        balance(bus)
