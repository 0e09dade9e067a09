"""The truth of a case instead of its processes: runners for campaigns and steps that take milliseconds for a trial."""

from __future__ import annotations

import random
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from benchmarks.real_faults.case import Case
from benchmarks.real_faults.grade import MONITORS
from riot_bus.inject.apply import inject_log
from riot_bus.trial.baseline import Baseline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation

SIGNATURES = {
    "crash": "crash in node: the report's fault",
    "hang": "hang of node: the report's fault",
    "silent": "silent of node: nothing on answer",
    "nan": "mined finite of answer:value",
    "wrong": "range of answer:error",
    "none": "",
}
OWN = "crash in node: a payload of another form"


class TruthRunner:
    """Answers trials by the truth of a case; a `RunnerFactory` and its own runner."""

    parallelism = 64

    def __init__(self, case: Case) -> None:
        self._case, self._registry = case, TypeRegistry()
        self.asked = 0
        """Number of trials so far."""

    def unit(self, *_: Any, **__: Any) -> TruthRunner:
        """Return itself."""
        return self

    def system(self, *_: Any, **__: Any) -> TruthRunner:
        """Return itself: there is nothing around the unit."""
        return self

    def baseline(self, unit: str, log: Callable[[], Sequence[Message]]) -> Baseline:
        """Return what nominal trials of a process that answers each input would show."""
        messages, probe = tuple(log()), self._case.probe
        counts = Counter({"answer": len(messages)})
        answers = {"answer": len(probe)} if probe else {}
        return Baseline(trials=3, log=messages, probe=probe, log_answers=counts, probe_answers=answers)

    def in_system(self, *_: Any, **__: Any) -> Baseline:
        """Return a baseline of nothing."""
        return Baseline()

    def keep_evidence(self, *_: Any, **__: Any) -> bool:
        """Keep nothing and return False."""
        return False

    def close(self) -> None:
        """Do nothing, since nothing was started."""

    def run(self, cases: Sequence[TestCase]) -> list[Outcome]:
        """Answer all cases."""
        self.asked += len(cases)
        return [self._answer(case) for case in cases]

    def _answer(self, case: TestCase) -> Outcome:
        file, reached, ahead = self._case.file, list[list[int]](), list[int]()
        messages, touched = inject_log(
            case.messages, case.injections, registry=self._registry, seed=case.seed, reached=reached, ahead=ahead
        )
        verdict, index = self._case.verdict(messages if case.unprobed else self._case.followed(messages))
        if verdict == "known" and random.Random(f"{case.digest()} {case.again}").random() >= file.chance:
            verdict, index = "", len(messages)
        found: tuple[Violation, ...] = ()
        if verdict:
            symptom, signature = ("crash", OWN) if verdict == "own" else (file.symptom, SIGNATURES[file.symptom])
            found = (Violation(MONITORS.get(symptom, ("range",))[0], "node", signature),)
        ended = verdict == "own" or (verdict and file.symptom in ("crash", "hang"))
        sent = min(index + 1, len(messages)) if ended else len(messages)
        turns = bisect_left(ahead, sent) if ended else len(case.messages)  # as in a trial: what came before its end
        statistics = {
            "played": sent,
            "messages": len(messages),
            "modified": sum(number < turns for number, _, _ in touched),
            "delivered": [sum(number < turns for number in each) for each in reached],
            "outputs": sent,
        }
        return Outcome(Verdict.FAIL if found else Verdict.PASS, found, seconds=0.001, statistics=statistics)
