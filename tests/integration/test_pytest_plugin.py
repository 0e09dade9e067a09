"""The plug-in as its users have it: pytest in a process of its own, real components, a real bus."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message

pytestmark = pytest.mark.integration
pytest_plugins = ["pytester"]

DOUBLER = """
import json, sys, threading, zenoh
session = zenoh.open(zenoh.Config.from_env())
out = session.declare_publisher("cmd")
def doubled(sample):
    out.put(json.dumps({"v": 2 * json.loads(sample.payload.to_bytes())["x"]}))
subscriber = session.declare_subscriber("pos", doubled)
threading.Event().wait()
"""

HEAD = f"""
import asyncio, os, sys, unittest
import pytest, zenoh

DOUBLER = {DOUBLER!r}

@pytest.fixture
def node(riot):
    return riot.start([sys.executable, "-c", DOUBLER], subscribes=["pos"], timeout=60)

def ask(riot, count=1):
    for number in range(count):
        riot.put("pos", {{"x": 1.0}})
    return [each.read("v") for each in riot.record.wait_for("cmd", count, timeout=60)]
"""

PLAN = """
[[inject]]
topic = "pos"
field = "x"
value = 9.0
first = 1
last = 1
"""


def run(pytester: pytest.Pytester, text: str, *options: str) -> pytest.RunResult:
    pytester.makepyfile(test_it=HEAD + text)
    (pytester.path / "nine.toml").write_text(PLAN)
    # a process of its own: the plug-in of this one is the same module, and warnings are errors here
    return pytester.runpytest_subprocess("-p", "no:cacheprovider", "-p", "no:randomly", *options)


def logs(pytester: pytest.Pytester) -> list[str]:
    return sorted(path.name.rpartition("-")[0] for path in (pytester.path / "riot-logs").glob("*.mcap"))


def test_what_passes_what_is_changed_and_what_is_injected_is_seen(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
def test_nothing_is_intercepted(riot, node):
    assert ask(riot) == [2.0]
    assert riot.sent("pos")[0].read("x") == 1.0

def test_a_function_intercepts(riot, node):
    @riot.interceptor
    def more(event):
        event.set("x", event.read("x") + 1)
    riot.intercept("pos")
    assert ask(riot) == [4.0]
    assert [riot.sent("pos")[0].read("x"), riot.delivered("pos")[0].read("x")] == [1.0, 2.0]
    assert riot.counts()["pos"].changed == 1

def test_text_names_an_interceptor(riot, node):
    riot.interceptor("drop every=2 select=pos")
    for x in (1.0, 2.0):
        riot.put("pos", {"x": x})
    riot.record.wait_for("cmd", timeout=60)
    assert riot.counts()["pos"].dropped == 1

@pytest.mark.parametrize("number", range(2))
@pytest.mark.riot(plan="nine.toml")
def test_numbers_of_messages_begin_anew_with_each_test(riot, node, number):
    assert ask(riot, 3) == [2.0, 18.0, 2.0]

@pytest.mark.riot(intercept="pos")
def test_code_in_this_process_is_in_the_last_segment(riot, riot_segment):
    with zenoh.open(zenoh.Config.from_env()) as unit, riot_segment("system").open() as system:
        with unit.declare_subscriber("pos", lambda sample: None):
            riot.wait_subscribed("pos", timeout=60)
            system.put("pos", b'{"x": 3}')
            assert riot.record.wait_for("pos where x > 2", timeout=60)[0].message.segment == "system"

@pytest.mark.riot(segment="system")
def test_or_in_that_of_the_marker(riot, riot_segment):
    assert os.environ["ZENOH_CONFIG"] == riot_segment("system").variables["ZENOH_CONFIG"]

def test_without_riot_there_is_no_segment():
    assert "ZENOH_CONFIG" not in os.environ

class TestLasting:  # it would answer in the tests that follow, too
    @pytest.fixture(scope="class")
    def lasting(self, riot_router):
        with riot_router.start([sys.executable, "-c", DOUBLER], subscribes=["pos"], timeout=60) as process:
            yield process

    @pytest.mark.parametrize("number", range(3))
    @pytest.mark.riot(plan="nine.toml")
    def test_a_component_may_live_over_many_tests(self, riot, lasting, number):
        assert ask(riot, 3) == [2.0, 18.0, 2.0]

class TestOld(unittest.TestCase):
    @pytest.fixture(autouse=True)
    def given(self, riot, node):
        self.riot = riot

    def test_old(self):
        assert ask(self.riot) == [2.0]

@pytest.mark.parametrize("change", [0.0, 0.01, 1.0])
def test_what_is_expected_comes(riot, node, change):
    from riot_bus import LogWriter, Message
    with LogWriter(f"expected-{change}.mcap") as log:
        log.write(Message(0, "cmd", b'{"v": %f}' % (2.0 + change)))
    ask(riot)
    if change < 1:
        riot.expect(f"expected-{change}.mcap", tolerances=["cmd:v=0.02"])
    else:
        with pytest.raises(AssertionError, match="cmd"):
            riot.expect(f"expected-{change}.mcap", tolerances="cmd:v=0.02")

def test_event_loops_go_on(riot, node):
    async def main():
        riot.put("pos", {"x": 1.0})
        return await riot.record.arrived("cmd", timeout=60)
    assert len(asyncio.run(main())) == 1
""",
    )
    result.assert_outcomes(passed=16)
    assert logs(pytester) == []


def test_the_page_works_as_printed(pytester: pytest.Pytester) -> None:
    page = (Path(__file__).parents[2] / "docs/pytest.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```\w+\n# (\S+)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert [name for name, _ in blocks] == ["test_drive.py", "nan.toml", "drive.py"]
    for name, text in blocks:
        (pytester.path / name).write_text(text, encoding="utf-8")
    pytester.runpytest_subprocess("-p", "no:cacheprovider").assert_outcomes(passed=3)


def test_a_test_that_shows_less_than_it_seems_to_fails(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
@pytest.mark.riot(intercept="nobody/says/this")
def test_nothing_came():
    pass

@pytest.mark.riot(plan="nine.toml")
def test_nothing_was_injected(riot, node):
    ask(riot)

def test_an_interceptor_raises(riot, node):
    @riot.interceptor
    def bad(event):
        raise ValueError("on purpose")
    riot.intercept("pos")
    ask(riot)

def test_an_interceptor_is_never_asked(riot):
    riot.interceptor(lambda event: None)

@pytest.mark.riot(plan="nine.toml")
def test_the_component_is_where_the_test_is(riot):
    riot.start([sys.executable, "-c", DOUBLER], segment="system", subscribes=[])
    riot.wait_subscribed("pos", segment="system", timeout=60)
    assert ask(riot, 2) == [2.0, 2.0]

def test_the_component_has_crashed(riot):
    riot.start([sys.executable, "-c", "import os; os.abort()"]).wait(60)

def test_that_is_what_was_wanted(riot):
    riot.intercept("nobody", required=False)
    riot.inject("nine.toml", required=False)
    riot.interceptor(lambda event: None, required=False)

@pytest.mark.riot(plan="nine.toml")
def test_a_test_that_is_skipped_shows_nothing():
    pytest.skip("no hardware")

@pytest.mark.xfail(strict=True)
@pytest.mark.riot(plan="nine.toml")
def test_nor_does_one_that_is_to_fail():
    raise ValueError
""",
    )
    result.assert_outcomes(passed=7, errors=6, skipped=1, xfailed=1)
    result.stdout.fnmatch_lines_random(
        [
            "*messages of nobody/says/this: none was intercepted*",
            "*injection 0 (set of pos:x) was not carried out*",
            "*interceptor bad raised in 1 message*",
            "*saw nothing: name the topics that it is to see, by `intercept` or `topics`*",
            "*messages of pos: they came from segment system, and subscribers are in system*",
            "*has ended with status -6*",
        ]
    )


def test_the_log_of_a_failed_test_is_kept_and_told(pytester: pytest.Pytester) -> None:
    text = """
def test_good(riot, node):
    ask(riot)

def test_bad(riot, node):
    assert ask(riot) == [3.0]

@pytest.fixture
def broken():
    yield
    raise OSError("cannot be taken down")

def test_worse(riot, broken):
    pass
"""
    result = run(pytester, text, "--riot-seed", "7", "--junitxml=results.xml")
    result.assert_outcomes(passed=2, failed=1, errors=1)
    assert logs(pytester) == ["test_it.py_test_bad", "test_it.py_test_worse"]
    result.stdout.fnmatch_lines(
        ["log:   *test_it.py_test_bad-*.mcap", "again: pytest *test_it.py::test_bad* --riot-seed 7"]
    )
    (path,) = (pytester.path / "riot-logs").glob("*bad*.mcap")
    junit = (pytester.path / "results.xml").read_text()
    assert junit.count(f'name="riot-log" value="{path}"') == 1
    with LogReader(path) as log:
        assert [message.key for message in log.messages()] == ["pos", "cmd"]
        assert log.metadata["test"].endswith("::test_bad")

    run(pytester, text, "--riot-record=always", f"--riot-record-dir={pytester.path / 'all'}").assert_outcomes(
        passed=2, failed=1, errors=1
    )
    assert len(list((pytester.path / "all").glob("*.mcap"))) == 3
    run(pytester, text, "--riot-record=never", f"--riot-record-dir={pytester.path / 'none'}")
    assert not (pytester.path / "none").exists()


def test_tests_in_several_processes_do_not_meet(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
@pytest.mark.parametrize("number", range(12))
@pytest.mark.riot(plan="nine.toml")
def test_alone(riot, node, number):
    assert ask(riot, 3) == [2.0, 18.0, 2.0]
    assert len(riot.sent("pos")) == 3
""",
        "-n3",
    )
    result.assert_outcomes(passed=12)


def test_a_marker_that_cannot_be_meant_is_refused(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
@pytest.mark.riot(plans="nine.toml")
def test_misspelt():
    pass

@pytest.mark.riot(segment="nowhere")
def test_no_such_segment():
    pass
""",
    )
    result.assert_outcomes(errors=2)
    result.stdout.fnmatch_lines_random(["*plan=None, segment=None, intercept=()*", "*no segment 'nowhere'*"])


def test_a_small_campaign_and_a_finding_of_it(pytester: pytest.Pytester) -> None:
    (pytester.path / "unit.py").write_text(UNIT)
    (pytester.path / "riot.toml").write_text(SYSTEM)
    with LogWriter(pytester.path / "nominal.mcap", registry=TypeRegistry()) as log:
        for number in range(5):
            log.write(Message(number * 10_000_000, "in", b'{"x": 3}', sequence=number))
    result = run(
        pytester,
        """
def test_robust(riot):
    riot.explore("riot.toml", trials=30, steps=["minimize"], out="out")

def test_once_found(riot_finding):
    import pathlib
    (folder,) = pathlib.Path("out/findings").iterdir()
    riot_finding(folder.resolve())
""",
    )
    result.assert_outcomes(failed=2)
    result.stdout.fnmatch_lines_random(["*1 finding in * of divider*", "*again *riot reproduce *", "*trials of *fail*"])


UNIT = """
import json, os, threading, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([os.environ["ENDPOINT"]]))
session = zenoh.open(config)
out = session.declare_publisher("out")
def divided(sample):
    out.put(json.dumps({"y": 1 // int(json.loads(sample.payload.to_bytes())["x"])}))
subscriber = session.declare_subscriber("in", divided)
threading.Event().wait()
"""

SYSTEM = """
[system]
name = "small"
nominal = "nominal.mcap"

[components.divider]
command = ["{python}", "unit.py"]
env = { ENDPOINT = "{endpoint}" }
inputs = ["in"]
outputs = ["out"]

[unit.divider]
"""
