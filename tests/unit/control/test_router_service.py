from __future__ import annotations

import json
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from riot_bus.config.router_settings import RouterSettings, SegmentSettings
from riot_bus.control.commands import answer, refusal
from riot_bus.control.remote import Remote, find_routers
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import merged
from riot_bus.control.router_process import _report_ready
from riot_bus.control.router_service import ROUTER_COMMANDS as COMMANDS
from riot_bus.control.router_service import RouterService
from riot_bus.control.terminal import Foreground
from riot_bus.graph.history import replay
from riot_bus.graph.model import ConnectedComponent
from riot_bus.log.reader import LogReader
from riot_bus.pipeline.runner import Pipeline
from riot_bus.router.bus import Bus
from riot_bus.router.pipeline_executor import PipelineExecutor, end_interceptors
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import free_endpoint, wait_until

PLAN = '[[inject]]\ntopic = "{}"\nfield = "v"\nvalue = 1\n'
FREE = ("a=tcp/127.0.0.1:0", "b=tcp/127.0.0.1:0")


class Passes:
    def __init__(self) -> None:
        self.seen: list[tuple[str, str]] = []
        self.started = self.stopped = 0

    def start(self) -> None:
        self.started += 1

    def stop(self) -> None:
        self.stopped += 1

    def message(self, event: object) -> None:
        pass

    def joined(self, component: ConnectedComponent) -> None:
        self.seen.append(("joined", component.segment))

    def left(self, component: ConnectedComponent) -> None:
        self.seen.append(("left", component.segment))


class Hangs(Passes):
    def __init__(self, hook: str) -> None:
        super().__init__()
        self.hook, self.go_on = hook, threading.Event()
        self.line = self._hang.__code__.co_firstlineno + 2

    def _hang(self, hook: str) -> None:
        if self.hook == hook:
            self.go_on.wait(30)

    def start(self) -> None:
        self._hang("start")
        super().start()

    def stop(self) -> None:
        self._hang("stop")
        super().stop()

    def joined(self, component: ConnectedComponent) -> None:
        self._hang("joined")


def service(folder: Path, *interceptors: object, **flags: Any) -> RouterService:
    settings = merged(RouterSettings(), RouterOptions(segments=FREE, **flags))
    registry = TypeRegistry(load_adapters())
    return RouterService(settings, interceptors=interceptors, registry=registry, folder=folder, scouting=None)


@pytest.fixture
def router(tmp_path: Path) -> Iterator[RouterService]:
    with service(tmp_path, Passes(), intercept=["cut/**"]) as opened:
        yield opened


def test_keys_are_added_and_removed_by_those_who_own_them(router: RouterService) -> None:
    assert router.intercept_add(["more", "/odom"]) == ["cut/**", "more", "/odom"]
    assert router.intercept_remove(["/odom"]) == ["cut/**", "more"]
    wrong = (([], "no key"), (["x" * 2000], "longer than"), (["a//"], "a//"), (["@riot/**"], "cannot be intercepted"))
    for keys, text in wrong:
        with pytest.raises(ConfigError, match=text):
            router.intercept_add(keys)
    with pytest.raises(ConfigError, match="did you mean 'more'"):
        router.intercept_remove(["mor"])
    assert router.status()["intercepted"] == ["cut/**", "more"]


def test_a_plan_brings_its_topics_and_takes_them_away(router: RouterService) -> None:
    assert router.plan_load(PLAN.format("cut/x"), "one")["intercepted"] == ["cut/**"]  # included already
    assert router.plan_load(PLAN.format("free/x"), "two")["intercepted"] == ["cut/**", "free/x"]
    assert [each["name"] for each in router.status()["interceptors"]] == ["Passes", "inject"]
    with pytest.raises(ConfigError, match="not intercepted on your account"):
        router.intercept_remove(["free/x"])
    with pytest.raises(ConfigError, match="three: injec"):
        router.plan_load("[[injec]]", "three")
    assert router.status()["plan"]["name"] == "two"
    assert router.plan_clear()["plan"] is None
    assert router.status()["plan"] is None
    assert wait_until(lambda: router.status()["intercepted"] == ["cut/**"], 60)


@contextmanager
def a_change_in_progress(monkeypatch: pytest.MonkeyPatch, place: str, do: Callable[[], object]) -> Iterator[None]:
    """Let a change wait inside a function of the bus until the block ends; then wait for the change."""
    inside, go_on = threading.Event(), threading.Event()
    change = getattr(Bus, place)

    def slow(self: Bus, *arguments: Any, **options: Any) -> None:
        inside.set()
        assert go_on.wait(60)
        change(self, *arguments, **options)

    with monkeypatch.context() as patched:
        patched.setattr(Bus, place, slow)
        thread = threading.Thread(target=do)
        thread.start()
        assert inside.wait(60)
        yield
    go_on.set()
    thread.join(60)
    assert not thread.is_alive()


def test_urgent_commands_wait_for_no_change(
    router: RouterService, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    router.plan_load(PLAN.format("free/x"), "p")
    router.record_start("a.mcap")
    with a_change_in_progress(monkeypatch, "set_intercept", lambda: router.intercept_add(["more"])):
        cleared = router.plan_clear()
        assert (cleared["plan"], cleared["former"]["name"]) == (None, "p")
        assert router.record_stop()["file"] == str(tmp_path / "a.mcap")
        assert (router.status()["plan"], router.status()["recording"]) == (None, None)
        assert router.status()["intercepted"] == ["cut/**", "free/x"]  # what is true meanwhile
    assert wait_until(lambda: router.status()["intercepted"] == ["cut/**", "more"], 60)
    with LogReader(tmp_path / "a.mcap") as reader:
        assert not reader.loss


def test_a_plan_that_is_being_loaded_does_not_come_into_force_after_a_clear(
    router: RouterService, monkeypatch: pytest.MonkeyPatch
) -> None:
    router.plan_load(PLAN.format("free/w"), "former")
    failed: list[str] = []

    def load() -> None:
        with pytest.raises(EnvironmentFaultError, match="plan/clear came before p was loaded"):
            router.plan_load(PLAN.format("free/x"), "p")
        failed.append("p")

    with a_change_in_progress(monkeypatch, "set_intercept", load):
        assert router.plan_clear()["plan"] is None
    assert failed == ["p"]
    assert wait_until(lambda: router.status()["intercepted"] == ["cut/**"], 60)
    assert router.status()["plan"] is None
    assert router.plan_load(PLAN.format("free/x"), "next")["plan"]["name"] == "next"
    assert router.status()["plan"]["name"] == "next"


def test_a_recording_that_is_being_started_does_not_go_on_after_a_stop(
    router: RouterService, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    failed: list[str] = []

    def start() -> None:
        with pytest.raises(EnvironmentFaultError, match="record/stop ended"):
            router.record_start("a.mcap")
        failed.append("a")

    with a_change_in_progress(monkeypatch, "set_recorder", start):
        assert router.record_stop()["file"] == str(tmp_path / "a.mcap")
    assert failed == ["a"]
    assert router.status()["recording"] is None
    assert router.bus._deliveries.surroundings.recorder is None
    assert router.record_start("b.mcap") == {"file": str(tmp_path / "b.mcap")}


def test_the_keys_of_a_router_are_counted_over_all_questions(router: RouterService) -> None:
    with pytest.raises(ConfigError, match="more than 256 key expressions"):
        router.intercept_add([f"k/{number}" for number in range(256)])
    router.intercept_add([f"cut/{number}" for number in range(200)])  # `cut/**` includes them, so none is a new cut
    with pytest.raises(ConfigError, match="more than 256 key expressions"):
        router.intercept_add([f"cut/more{number}" for number in range(100)])
    for _ in range(3):
        assert router.intercept_add(["k/1", "k/2"]) == ["cut/**", "k/1", "k/2"]
        assert router.intercept_remove(["k/1", "k/2"]) == ["cut/**"]
    assert router.bus._cut._retired == []  # else `status` took longer after each change
    with pytest.raises(ConfigError, match="more than 256 key expressions"):
        router.plan_load("".join(PLAN.format(f"cut/plan{number}") for number in range(100)), "p")


def test_a_refused_change_changes_nothing(router: RouterService) -> None:
    with pytest.raises(ConfigError, match="is not a key expression"):
        router.plan_load(PLAN.format("a//b"), "bad")
    status = router.status()
    assert (status["plan"], status["intercepted"], len(status["interceptors"])) == (None, ["cut/**"], 1)


def test_a_recording_begins_goes_on_elsewhere_and_ends(router: RouterService, tmp_path: Path) -> None:
    for operation in (router.record_stop, router.record_split):
        with pytest.raises(ConfigError, match="does not record"):
            operation()
    assert router.record_start("a.mcap") == {"file": str(tmp_path / "a.mcap")}
    with pytest.raises(ConfigError, match="is recording already"):
        router.record_start("b.mcap")
    with pytest.raises(ConfigError, match="exists already"):
        router.record_split("a.mcap")
    assert router.record_split()["file"] == str(tmp_path / "a-2.mcap")
    assert router.status()["recording"]["file"] == str(tmp_path / "a-2.mcap")
    assert router.record_stop()["lost"] == 0
    assert router.status()["recording"] is None
    assert Path(router.record_start()["file"]).name.startswith("router-")
    for name in ("a.mcap", "a-2.mcap"):
        with LogReader(tmp_path / name) as reader:
            assert not reader.loss
            assert reader.metadata["router"] == "router"


def test_what_is_behind_the_hash_of_an_endpoint_is_not_told_and_not_recorded(tmp_path: Path) -> None:
    place = free_endpoint().replace("tcp", "ws")  # Zenoh does not say where it listens for ws
    segments = [f"a={place}#so_sndbuf=65536", "b=tcp/127.0.0.1:0#so_sndbuf=65536"]
    flags = RouterOptions(segments=segments, record=tmp_path / "a.mcap")
    with RouterService(merged(RouterSettings(), flags), scouting=None) as router:
        told = [json.dumps(router.status())]
        for as_json in (True, False):
            _report_ready(router, Foreground(told.append, told.append, as_json=as_json))
        assert router.endpoints["a"] == (f"{place}#...",)
    assert all(f"{place}#..." in text and "65536" not in text for text in told)
    with LogReader(tmp_path / "a.mcap") as reader:
        assert reader.metadata["segments"] == f"a={place}#... b=tcp/127.0.0.1:0#..."


def test_components_are_told_to_interceptors_and_written_into_each_log(tmp_path: Path) -> None:
    passes = Passes()
    log = tmp_path / "run.mcap"
    with service(tmp_path, passes, intercept=["cut/**"], record=log) as router:
        router.watch()
        with Remote(router.endpoints["b"][0]) as remote, open_client(router.endpoints["b"][0]):
            assert wait_until(lambda: ("joined", "b") in passes.seen, 10)
            assert [each.segment for each in router.graph().components] == ["b"]
            assert remote.ask("graph")["components"][0]["segment"] == "b"
            split = Path(router.record_split()["file"])
        assert wait_until(lambda: ("left", "b") in passes.seen, 10)
    assert sorted(passes.seen) == [("joined", "b"), ("left", "b")]  # nothing is said of who only controls
    for path, counts in ((log, [1]), (split, [1, 0])):
        with LogReader(path) as reader:
            graphs = [graph for _, graph in replay(reader.notes("riot_bus.graph"))]
        assert [len(graph.components) for graph in graphs][-len(counts) :] == counts


def test_an_interceptor_that_hangs_when_it_is_told_of_a_component_is_bypassed(tmp_path: Path) -> None:
    hangs, passes = Hangs("joined"), Passes()
    with service(tmp_path, hangs, passes, intercept=["cut/**"], budget=0.2) as router:
        router.watch()
        with open_client(router.endpoints["b"][0]):
            assert wait_until(lambda: ("joined", "b") in passes.seen, 10)
            first = router.status()["interceptors"][0]
            assert "blocked for more than 0.2 s" in first["bypassed"]
            assert first["place"] == f"{__file__}:{hangs.line}"
    assert hangs.stopped == 0
    hangs.go_on.set()


def test_an_interceptor_that_hangs_when_it_comes_in_is_bypassed_and_the_others_come_in() -> None:
    hangs, passes = Hangs("start"), Passes()
    pipeline = Pipeline([], registry=TypeRegistry())
    pipeline.start()
    gate = PipelineExecutor(pipeline, budget_s=0.2)
    gate.start()
    coming = threading.Thread(target=gate.replace, args=([hangs, passes],))
    coming.start()
    assert wait_until(lambda: pipeline.errors.get("Hangs") is not None, 10)
    event, result = gate.feed("x", 1, message=Message(1, "x", b""))  # nobody waits for the hanging one
    assert (event.dropped, result, passes.started) == (False, None, 1)
    hangs.go_on.set()
    coming.join(10)
    end_interceptors(pipeline)
    gate.close()
    assert (hangs.stopped, passes.stopped, passes.started) == (0, 1, 1)


def test_an_interceptor_that_does_not_stop_is_left_behind() -> None:
    hangs, passes = Hangs("stop"), Passes()
    pipeline = Pipeline([hangs, passes], registry=TypeRegistry())
    pipeline.start()
    end_interceptors(pipeline, patience_s=0.1)
    assert passes.stopped == 1
    assert pipeline.errors["Hangs"].place == f"{__file__}:{hangs.line}"
    hangs.go_on.set()


def test_only_chosen_segments_are_answered(tmp_path: Path) -> None:
    with service(tmp_path, control=["b"]) as router:
        assert find_routers(router.endpoints["b"][0]) == ["router"]
        with Remote(router.endpoints["a"][0]) as remote, pytest.raises(EnvironmentFaultError, match="no riot router"):
            remote.ask("status")
    with pytest.raises(ConfigError, match="no segment 'c'"):
        merged(RouterSettings(), RouterOptions(segments=FREE, control=["c"]))


@pytest.mark.parametrize(
    ("segment", "local"),
    [
        ({"listen": ["tcp/127.0.0.1:1", "tcp/[::1]:1", "unixsock-stream//tmp/x"]}, True),
        ({}, True),
        ({"listen": ["tcp/0.0.0.0:1"]}, False),
        ({"listen": ["tcp/127.0.0.1:1", "tls/192.168.0.1:1"]}, False),
        ({"connect": ["tcp/192.168.0.1:1"]}, False),
        ({"config": {"scouting/multicast/enabled": True}}, False),
        ({"config": {"scouting/gossip/enabled": False}}, True),
    ],
)
def test_control_stays_on_this_machine_unless_the_settings_say_so(segment: dict[str, Any], local: bool) -> None:
    settings = RouterSettings(segments={"x": SegmentSettings(**segment)})
    assert settings.controlled_from == (("x",) if local else ())
    named = RouterSettings(segments=settings.segments, control=("x",))
    assert named.controlled_from == ("x",)
    assert RouterSettings(segments=settings.segments, control=()).controlled_from == ()


def test_a_router_that_is_not_open_says_so(tmp_path: Path) -> None:
    with warnings.catch_warnings(), pytest.raises(EnvironmentFaultError, match="not open"):
        service(tmp_path).status()
    with pytest.raises(ConfigError, match="would see nothing"):
        service(tmp_path, Passes())


def test_shutdown_wakes_whoever_runs_it(tmp_path: Path) -> None:
    router = service(tmp_path)
    router.shutdown()
    assert router.stopping.is_set()


def test_answers_and_refusals_are_versioned(router: RouterService) -> None:
    document = json.loads(answer(router, "lab", "counts", b"", {}, commands=COMMANDS))
    assert (document["version"], document["router"], document["command"]) == (1, "lab", "counts")
    refused = json.loads(refusal("lab", ConfigError("no", where="here", hint="do")))
    assert {key: refused[key] for key in ("message", "where", "hint", "exit_code")} == {
        "message": "no",
        "where": "here",
        "hint": "do",
        "exit_code": 2,
    }
    assert "KeyError" in json.loads(refusal("lab", KeyError("x")))["message"]


@pytest.mark.parametrize(
    ("command", "payload", "text"),
    [
        ("nope", b"", "no command 'nope'"),
        ("intercept/add", b"", "not a list of texts"),
        ("intercept/add", b'{"keys": [1]}', "not a list of texts"),
        ("intercept/add", b"[]", "not a JSON object"),
        ("intercept/add", b"{" * 60_000, "not JSON"),
        ("intercept/add", b"\xff", "not UTF-8"),
        ("intercept/add", b"x" * 70_000, "too large"),
        ("intercept/remove", b'{"kyes": []}', "did you mean 'keys'"),
        ("plan/load", b"\xff\xfe", "not UTF-8"),
        ("plan/load", b"a = " + b"[" * 5000, "not a TOML file"),
        ("plan/load", b"", "injects nothing"),
        ("plan/load", b"a." * 24_000 + b"a = 1", "is too long"),  # took 12 s
        ("plan/load", PLAN.format("x/" + "$*a" * 8 + "$*b").encode(), "too many wildcards"),  # froze the router
        ("intercept/add", json.dumps({"keys": ["x/" + "$*a" * 8 + "$*b"]}).encode(), "too many wildcards"),
        ("intercept/add", json.dumps({"keys": ["**/a/" * 8 + "b"]}).encode(), "too many wildcards"),
        ("record/start", b'{"path": 7}', "not a text"),
        ("record/start", b'{"path": "../x.mcap"}', "outside"),
    ],
)
def test_malformed_requests_are_refused(router: RouterService, command: str, payload: bytes, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        answer(router, "lab", command, payload, {}, commands=COMMANDS)


def test_questions_to_all_are_those_that_only_read() -> None:
    assert sorted(name for name, command in COMMANDS.items() if command.reads) == ["counts", "graph", "status"]
