from __future__ import annotations

from pathlib import Path

from riot_bus.monitors.liveness import LIVENESS
from riot_bus.monitors.model import NO_SIGNS, ComponentView, Signs, TrialView
from riot_bus.types.registry import TypeRegistry

TRACEBACK = 'Traceback (most recent call last):\n  File "/srv/u.py", line 7, in f\n    x()\nValueError: 1\n'


def signatures(
    signs: Signs = NO_SIGNS, *, status: int | None = None, errors: str = "", settled: bool = True, stalled: bool = False
) -> list[str]:
    component = ComponentView("part", status, errors, Path("/srv"), signs=signs)
    view = TrialView([component], settled, 2.0, TypeRegistry(), stalled=["part"] if stalled else [])
    return [violation.signature for monitor in LIVENESS for violation in monitor().judge(view)]


def test_each_way_to_fail_has_its_name() -> None:
    assert signatures() == []
    assert signatures(status=3) == ["crash in part: exit status 3"]
    assert signatures(status=-11) == ["crash in part: SIGSEGV"]
    assert signatures(Signs(ended="status 0"), status=0) == ["exit of part: status 0"]
    assert signatures(Signs(lost=["worker"])) == ["exit of part: a thread has ended: worker"]
    assert signatures(Signs(blocked=["a", "b"])) == ["hang of part: in a, b"]
    assert signatures(Signs(blocked=["spin"]), settled=False) == ["hang of part: in spin"]
    assert signatures(settled=False) == ["hang of part"]
    assert signatures(stalled=True) == ["hang of part"]
    assert signatures(Signs(grown={"memory": "500 MB more"})) == ["growth of part: memory"]
    assert signatures(Signs(silent=["out"])) == ["silent of part: nothing on out"]


def test_what_comes_of_a_crash_is_no_failure_of_its_own() -> None:
    crash = ["crash in part: f: x()"]
    all_signs = Signs("status 0", ["out"], ["f"], ["worker"])
    assert signatures(all_signs, errors=TRACEBACK) == crash
    assert signatures(Signs(silent=["out"], lost=["worker"]), errors=TRACEBACK, settled=False) == crash


def test_a_failure_is_named_by_its_cause() -> None:
    assert signatures(Signs(silent=["out"], lost=["worker"])) == ["exit of part: a thread has ended: worker"]
    assert signatures(Signs(silent=["out"], blocked=["swap"])) == ["hang of part: in swap"]
    assert signatures(Signs("the main thread has ended", ["out"], ["f"])) == ["exit of part: the main thread has ended"]


def test_a_component_that_was_ended_by_a_limit_has_not_crashed() -> None:
    component = ComponentView("part", -9, TRACEBACK, Path("/srv"), excess=("memory", "it had 3 GiB"))
    view = TrialView([component], True, 2.0, TypeRegistry())
    (violation,) = [violation for monitor in LIVENESS for violation in monitor().judge(view)]
    assert (violation.monitor, violation.signature) == ("limit", "limit of part: memory")
    assert violation.detail == "it had 3 GiB"


def test_a_known_hang_has_the_signature_of_the_one_that_was_waited_for() -> None:
    assert signatures(Signs(blocked=["spin"], known=True), settled=False) == ["hang of part: in spin"]


def test_a_traceback_of_a_process_that_goes_on_is_told_as_such() -> None:
    def detail(status: int | None) -> str:
        component = ComponentView("part", status, TRACEBACK, Path("/srv"))
        (found,) = LIVENESS[0]().judge(TrialView([component], True, 2.0, TypeRegistry()))
        return found.detail

    assert detail(None) == "ValueError: 1 (u.py:7); the process has not ended"
    assert detail(1) == "ValueError: 1 (u.py:7)"
