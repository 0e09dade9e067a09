"""What the page for users says of events, methods and failures; test_page.py tries its commands and its example."""

import inspect
import re
from pathlib import Path

import pytest

from riot_bus.pipeline.event import Event
from riot_bus.pipeline.runner import Pipeline
from riot_bus.router.pipeline_executor import BUDGET_S
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message

PAGE = (Path(__file__).parents[3] / "docs" / "interceptors.md").read_text(encoding="utf-8")
OURS = {"branch", "branches", "digest", "interceptor", "new_payload", "patched", "provenance", "restore", "seed"}
OURS |= {"snapshot", "touched"}
"""What the pipeline and shipped interceptors need of an event, and users do not."""


def section(title):
    return re.search(rf"^## {title}\n(.*?)(?=^## )", PAGE, re.MULTILINE | re.DOTALL).group(1)


def message(payload=b'{"x": 1.5}'):
    return Message(0, "a", payload)


def test_python_blocks_compile():
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert blocks
    for block in blocks:
        compile(block, "docs/interceptors.md", "exec")


def test_all_that_an_event_offers_is_on_the_page():
    fields = set(vars(Event(message(), "a", 0, 0.0))) | set(dir(Event))
    offered = {name for name in fields if not name.startswith("_")}
    named = set(re.findall(r"`event\.(\w+)", "".join(re.findall(r"^\|.*", section("Your own.*?"), re.MULTILINE))))
    assert named == offered - OURS


def test_the_methods_of_the_table_are_those_that_are_called():
    table = re.findall(r"^\| `(\w+)\((.*?)\)` \|", section("Lifecycle"), re.MULTILINE)
    assert [name for name, _ in table] == ["load", "start", "stop", "joined", "left"]
    calls = []

    def method(name, parameters):
        def called(self, *arguments):
            assert len(arguments) == parameters.count(",")
            calls.append(name)

        return called

    own = {name: method(name, parameters) for name, parameters in table}
    pipeline = Pipeline(
        [type("Mine", (), own | {"message": method("message", "self, event")})()], registry=TypeRegistry()
    )
    pipeline.feed(message())
    for hook in ("joined", "left"):
        pipeline.call(pipeline.stages[0], hook, object())
    pipeline.close()
    assert calls == ["load", "start", "message", "joined", "left", "stop"]
    assert pipeline.errors == {}


def test_load_may_refuse():
    class Mine:
        def load(self, registry):
            raise ConfigError("not here")

        def message(self, event): ...

    with pytest.raises(ConfigError, match="not here"):
        Pipeline([Mine()], registry=TypeRegistry())


def test_topics_say_what_it_wants_if_the_user_does_not():
    seen = []
    mine = type("Mine", (), {"topics": ["a"], "message": lambda self, event: seen.append(event.topic)})()
    pipeline = Pipeline([mine], registry=TypeRegistry())
    for key in "ab":
        pipeline.feed(message().with_(key=key))
    assert seen == ["a"]


def test_one_that_raises_is_left_out_for_this_message_and_asked_again():
    class Mine:
        def message(self, event):
            event.set("x", 0.0)
            event.drop()
            if event.index < 2:
                raise RuntimeError("boom")

    pipeline = Pipeline([Mine()], registry=TypeRegistry())
    results = [pipeline.feed(message()) for _ in range(3)]
    assert [result.dropped for result in results] == [False, False, True]
    assert [result.emissions[0].message is result.original for result in results[:2]] == [True, True]
    errors = pipeline.errors["Mine"]
    line = inspect.getsourcelines(Mine)[1] + 5
    assert (errors.count, errors.place) == (2, f"{__file__}:{line}")
    assert errors.first.rstrip().endswith("RuntimeError: boom")


@pytest.mark.parametrize("answer", [None, 5, "drop", False, Exception("not raised")])
def test_what_it_returns_does_not_matter(answer):
    mine = type("Mine", (), {"message": lambda self, event: answer})()
    pipeline = Pipeline([mine], registry=TypeRegistry())
    result = pipeline.feed(message())
    assert result.emissions[0].message is result.original
    assert pipeline.errors == {}


def test_the_budget_is_as_the_page_says():
    assert f"(`--budget`, {BUDGET_S:g} second)" in section("When an interceptor raises or blocks")


def test_choices_depend_on_what_the_page_names():
    def draw(*, name="mine", index=0, payload=b"{}", seed=0, key="a"):
        one = Event(Message(0, key, payload), key, index, 0.0)
        one.interceptor, one.seed = name, seed
        return one.draw()

    variants = [{}, {"name": "other"}, {"index": 1}, {"payload": b"[]"}, {"seed": 1}, {"key": "b"}]
    assert len({draw(**each) for each in variants}) == len(variants)
    assert draw() == draw()
