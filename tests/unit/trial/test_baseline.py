from __future__ import annotations

from riot_bus.processes.activity import STILL
from riot_bus.processes.python_report import ThreadStack
from riot_bus.trial.baseline import UNKNOWN, NominalTrial, baseline_of, probe_of
from riot_bus.vocabulary.message import Message


def log(*keys: str) -> list[Message]:
    return [Message(number, key, b"") for number, key in enumerate(keys)]


def stacks(*names: str) -> list[ThreadStack]:
    return [ThreadStack(tuple(name.split()), name) for name in names]


def nominal(probe: dict[str, int], *names: str, ended: bool = False, status: int | None = None) -> NominalTrial:
    return NominalTrial({"out": 30, "rare": len(names)}, probe, stacks(*names), ended, status)


def test_a_probe_is_short_and_has_the_last_message_of_each_key() -> None:
    messages = log("map", "mode", *["cmd"] * 10, "mode", *["cmd"] * 40, "start")
    probe = probe_of(messages)
    assert [message.key for message in probe] == ["mode", *["cmd"] * 16]  # what came once may be refused a second time
    assert probe[0] is messages[12]
    assert probe_of(messages[:3]) == tuple(messages[:3])
    assert [message.key for message in probe_of(log("map", "start"))] == ["map", "start"]  # there are no others
    assert probe_of([]) == ()


def test_a_probe_follows_trials_only_where_nominal_ones_have_shown_answers() -> None:
    known = baseline_of([nominal({"out": 15})], idle=STILL, log=log("cmd"))
    assert known.follows == known.probe == tuple(log("cmd"))
    assert baseline_of([nominal({})], idle=STILL, log=log("cmd")).follows == ()
    assert UNKNOWN.follows == ()


def test_only_what_all_nominal_trials_show_is_expected() -> None:
    trials = [nominal({"out": 16, "tick": 1}, "wait main"), nominal({"out": 15}, "wait main", "get worker")]
    found = baseline_of(trials, idle=STILL, log=log("cmd"))
    assert found.probe_answers == {"out": 15}
    assert found.log_answers == {"out": 30, "rare": 1}
    assert found.at_rest == {"wait": 1}
    assert found.threads == {"main": 1}
    assert (found.main_ends, found.ends, found.trials) == (False, False, 2)


def test_where_threads_stand_that_stand_elsewhere_at_rest() -> None:
    found = baseline_of([nominal({}, "wait main", "get worker")] * 3, idle=STILL, log=[])
    assert found.blocked(stacks("wait main", "get worker"), anywhere=True) == ()
    assert found.blocked(stacks("wait main", "swap handle worker"), anywhere=False) == ("swap",)
    new = stacks("wait main", "get worker", "sleep another")
    assert found.blocked(new, anywhere=False) == ()  # a thread more is no thread that is missed
    assert found.blocked(new, anywhere=True) == ("sleep",)


def test_a_thread_that_was_replaced_is_not_lost() -> None:
    found = baseline_of([nominal({}, "wait main", "get worker", "get worker")] * 3, idle=STILL, log=[])
    assert found.lost(stacks("wait main", "get worker")) == ("worker",)
    assert found.lost(stacks("wait main", "put worker", "get worker")) == ()


def test_what_ends_in_nominal_trials_may_end() -> None:
    found = baseline_of([nominal({}), nominal({}, ended=True, status=0)], idle=STILL, log=[])
    assert (found.main_ends, found.ends) == (True, True)
    assert baseline_of([], idle=STILL, log=[]) == UNKNOWN


def test_what_cannot_be_told_is_said() -> None:
    (nothing,) = UNKNOWN.untold
    assert "no nominal trials have passed" in nothing
    assert baseline_of([nominal({"out": 3}, "wait main")], idle=STILL, log=log("cmd")).untold == ()
    silent, native = baseline_of([nominal({})], idle=STILL, log=log("cmd")).untold
    assert "whether it falls silent" in silent
    assert "where its threads stand" in native
