from __future__ import annotations

from typing import Any

from riot_bus.control.reach import Bypass
from riot_bus.control.status import bypass_rows, count_rows, count_table, interceptor_rows, loss_rows, plan_row
from riot_bus.control.status_text import answer_lines, counts_lines, status_lines
from riot_bus.graph.model import ConnectedComponent
from riot_bus.inject.injection_plan import InjectionPlan
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.runner import OTHER_TOPICS, Pipeline
from riot_bus.router.counts import Losses, TopicCounts
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.redaction import escape_control_chars
from riot_bus.zenoh.link_watch import BrokenLink

PLAN = '[[inject]]\ntopic = "cut/x"\nfield = "v"\nvalue = 1\n'


class Raises:
    def message(self, event: object) -> None:
        raise RuntimeError("on purpose")


def pipeline() -> Pipeline:
    made = Pipeline([Selective(Raises(), When(select="cut/**", last=7), "mine")], registry=TypeRegistry())
    made.feed(Message(1, "cut/x", b"{}"))
    return made


def test_table_is_aligned() -> None:
    counts = {"a": TopicCounts(received=10_000, forwarded=10_000), "long/topic": TopicCounts(received=2, lost=2)}
    lines = count_table(counts)
    assert lines == [
        "topic       received  changed  added  forwarded  dropped  lost  held  recorded  unrecorded",
        "a              10000        0      0      10000        0     0     0         0           0",
        "long/topic         2        0      0          0        0     2     0         0           0",
    ]
    assert count_table(count_rows(counts)) == lines


def test_counts_say_whether_they_balance_and_are_bounded() -> None:
    counts = {f"t/{number}": TopicCounts(received=number, forwarded=number) for number in range(10)}
    counts["bad"] = TopicCounts(received=100)
    rows = count_rows(counts, most=3)
    assert list(rows) == ["bad", "t/8", "t/9", OTHER_TOPICS]
    assert [row["balanced"] for row in rows.values()] == [False, True, True, True]
    assert rows[OTHER_TOPICS]["received"] == sum(range(8))


def test_losses_are_true_when_something_was_lost() -> None:
    assert not Losses()
    assert Losses({"a": 1})
    assert Losses(recordings={"a": 1})
    assert Losses(links=(BrokenLink("s", "p", 0, "stalled"),))


def test_interceptors_tell_name_conditions_errors_and_place() -> None:
    (row,) = interceptor_rows(pipeline())
    assert (row["name"], row["errors"], row["error"]) == ("mine", 1, "RuntimeError: on purpose")
    assert row["conditions"] == {"select": "cut/**", "last": 7}
    assert row["place"].startswith(__file__)


def test_errors_are_shown_with_their_hints() -> None:
    class Refuses:
        def message(self, event: object) -> None:
            raise PayloadError("no such field", where="x", hint="name another")

    made = Pipeline([Refuses()], registry=TypeRegistry())
    made.feed(Message(1, "x", b"{}"))
    (row,) = interceptor_rows(made)
    assert row["error"] == "riot_bus.vocabulary.errors.PayloadError: x: no such field hint: name another"
    assert row["bypassed"] is None


def status(**changes: Any) -> dict[str, Any]:
    losses = Losses({"a": 2}, {"a": 1}, (BrokenLink("unit", "1f", 0, "stalled"),), {"no room": 2})
    component = ConnectedComponent("unit", "ab", name="evil\x1b[2J")
    bypass = Bypass("direct", (component, component), "a link", "set this")
    return {
        "name": "lab",
        "version": "1",
        "pid": 7,
        "uptime": 3.2,
        "segments": {
            "unit": {
                "endpoints": ["tcp/127.0.0.1:1"],
                "components": [{"zid": "ab", "mode": "client", "name": "evil\x1b[2J"}],
            }
        },
        "controlled_from": ["unit"],
        "intercepted": ["cut/**"],
        "interceptors": [{**interceptor_rows(pipeline())[0], "bypassed": "blocked"}],
        "plan": plan_row(InjectionPlan.parse(PLAN, "p.toml")),
        "recording": {"file": "x.mcap", "messages": 1, "lost": 0, "seconds": 2.0},
        "counts": count_rows({"a": TopicCounts(received=1, forwarded=1)}),
        "losses": loss_rows(losses),
        "departures": 0,
        "bypasses": bypass_rows([bypass]),
        "warnings": ["open to all"],
        **changes,
    }


def test_status_in_lines_says_all_and_obeys_nothing() -> None:
    lines = status_lines(status())
    text = "\n".join(lines)
    assert "\x1b" not in text
    assert lines[0] == "router lab, riot_bus 1, process 7, up for 3 s"
    for part in (
        "warning: open to all",
        "bypass: a way around the router is used",
        "hint: set this",
        "lost: 2 messages (no room: 2)",
        "lost: 1 message not recorded",
        "lost: segment unit: link to 1f broke (stalled)",
        "segment unit (control): tcp/127.0.0.1:1",
        "interceptor mine select=cut/** last=7",
        "  blocked",
        "errors: 1, last at",
        "plan p.toml: 1 injection, carried out 0 times",
        "recording: x.mcap (1 message, 0 lost, 2 s)",
    ):
        assert part in text, text
    assert "recording: no" in status_lines(status(recording=None, plan=None, counts={}))
    assert "intercepted services: /add, calc/*" in status_lines(status(services=["/add", "calc/*"]))


def test_answers_in_lines() -> None:
    assert answer_lines({"intercepted": []}) == ["intercepted: nothing"]
    assert answer_lines({"intercepted": ["a"], "plan": None, "former": None}) == ["intercepted: a", "no plan"]
    assert answer_lines({"former": "a.mcap", "file": "b.mcap"}) == ["finished: a.mcap", "recording: b.mcap"]
    assert answer_lines({"file": "b.mcap", "messages": 1, "lost": 0, "seconds": 1.0}) == [
        "recorded: b.mcap (1 message, 0 lost, 1 s)"
    ]
    assert counts_lines({"counts": {}, "losses": loss_rows(Losses())})[0].startswith("topic")
    assert escape_control_chars("a\nb") == "a\\nb"
