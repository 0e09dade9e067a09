"""Step `minimize`: from the failing log to the few messages that are needed, as simple as they can be (RIOT II-B a)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from riot_bus.campaign.confirm import join_logs
from riot_bus.chain.base.logs import FailingLog
from riot_bus.chain.base.workspace import StepRun
from riot_bus.chain.unit.absence import absent_messages, write_other_cause
from riot_bus.chain.unit.questions import (
    FEWEST,
    FreshCases,
    measured_rate,
    noise_of,
    nominal_passes,
    observed_in,
    unit_case,
)
from riot_bus.chain.unit.simplify import Simplification, spaced
from riot_bus.findings.records import AbsentRecord, FindingRecord, MinimalRecord, SimplifiedRecord
from riot_bus.generalize.minimize import BUDGET, CONFIDENCE, Minimal
from riot_bus.generalize.minimize import minimize as search
from riot_bus.statistics.noise import Noise
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import InconclusiveError

_UNMODIFIED, _DOUBT = 0.1, 0.02
"""Prior probability that the kept messages fail unmodified, and the doubt below which that is decided."""
_NEEDS_PROBE = frozenset({"silent", "growth", "limit", "mined"})
"""Monitors whose violations only a probe shows, or that may see them late."""


def minimize(step: StepRun, folder: Path, *, budget: int = BUDGET) -> MinimalRecord:
    """Shrink `failure.mcap` to `minimal.mcap`: it fails with the same signature, and no message can be taken away.

    Modified values return to nominal or simple ones as far as the failure persists. If no modification is needed,
    the record names the messages of the nominal log that are missing. If the step is interrupted, the best result so
    far is saved and marked as unproven.

    Raises:
        InconclusiveError: The failing log does not fail again.
    """
    return _Minimization(step, folder, budget).run()


@dataclass(frozen=True, slots=True)
class _Found:
    """The result so far: positions kept in the failing log, the messages as simplified, and figures about them."""

    kept: tuple[int, ...]
    log: FailingLog
    minimal: Minimal
    simplified: tuple[SimplifiedRecord, ...] = ()
    simplified_trials: int = 0

    def reduced(self, log: FailingLog, part: Minimal) -> _Found:
        """Return the result with a part of its messages, which `log` has in their present form."""
        return replace(self, kept=tuple(self.kept[place] for place in part.kept), log=log.keep(part.kept), minimal=part)

    @classmethod
    def of(cls, log: FailingLog, part: Minimal) -> Self:
        """Return the first result, a part of the failing log."""
        return cls(part.kept, log.keep(part.kept), part)


class _Minimization:
    """The state of one run of the step."""

    def __init__(self, step: StepRun, folder: Path, budget: int) -> None:
        self.step = step
        self.folder = folder
        self.budget = budget
        self.finding = FindingRecord.load(folder)
        self.context = step.workspace.context
        self.log = FailingLog.load(folder / "failure.mcap", registry=self.context.registry)
        self.cases = FreshCases(step.unit_runner(self.finding.unit))
        self.paced = self.context.file.unit[self.finding.unit].rate > 0
        self.nominal_passes = nominal_passes(self.finding) > 0
        self.needs_cause = self.nominal_passes and bool(self.log.originals)
        self.ask = self._failing
        self.best: _Found | None = None
        self.spent = 0
        self.missing: tuple[str, ...] = ()
        self.missing_failed = (0, 0)
        self.unprobed = False
        self.added = 0

    def run(self) -> MinimalRecord:
        try:
            self._leave_out_probe()
            found = self._without_modified(self._rated(self._simplified(self._messages())))
            absent = self._absent(found)
        except KeyboardInterrupt:
            if self.best and not MinimalRecord.exists(self.folder):
                figures = {"seed": self.step.workspace.seed, "trials": self.step.trials, "seconds": self.step.seconds}
                half = self._saved(self.best).model_copy(update={"interrupted": True, "one_minimal": False, **figures})
                half.save(self.folder)
            raise
        return self._saved(found, absent)

    def _leave_out_probe(self) -> None:
        """Go on without riot's probe, if the log fails without it, or with the probe's messages at its own end.

        Else rules would state values of messages that no other log has.
        """
        unit = self.finding.unit
        probe = self.step.workspace.runners.baseline(unit, lambda: self.step.workspace.unit_log(unit)).follows
        if not probe or self.finding.monitor in _NEEDS_PROBE:
            return
        self.unprobed = True
        for log in (self.log, self.log.followed_by(join_logs([self.log.messages, probe])[len(self.log.messages) :])):
            if self._decided(log, self._known())[-1]:
                self.added, self.log = len(log.messages) - len(self.log.messages), log
                return
        self.unprobed = False

    def _messages(self) -> _Found:
        """Return the messages that are needed, at least one of them modified if modified messages are the cause."""
        minimal = self._shrunk(self.log)
        found = _Found.of(self.log, minimal)
        if not self.needs_cause or not minimal.kept:
            return found
        unmodified = found.log.restored()
        failed, total, fails = self._decided(unmodified, minimal.noise)
        if not fails:
            return found
        self.best = None  # what was found so far has another cause
        if self._decided(self.log.restored(), minimal.noise)[-1]:
            # No modification matters; missing messages do.
            self.needs_cause, self.log = False, self.log.restored()
        else:
            self._tell_other_cause(unmodified, (failed, total))
            self.ask = self._failing_if_modified
        return _Found.of(self.log, self._shrunk(self.log))

    def _shrunk(self, log: FailingLog, within: _Found | None = None) -> Minimal:
        """Return the messages of a log that are needed.

        Args:
            within: The result so far that holds this log, to be reduced further; None for a first search.
        """
        n = len(log.messages)
        modified = [place for place, message in enumerate(log.messages) if message.sequence in log.originals]

        def better(part: Minimal) -> None:
            self.best = _Found.of(log, part) if within is None else within.reduced(log, part)

        minimal = search(
            n,
            lambda questions: self.ask([log.keep(kept) for kept in questions]),
            weights=[
                (20.0 if message.sequence in log.originals else 0.1) + (index + 1) / n
                for index, message in enumerate(log.messages)
            ],
            groups=[self.context.registry.topic(message.key) for message in log.messages],
            causes=modified if self.needs_cause and modified else None,
            likely=within is not None,
            noise=self._known() if within is None else within.minimal.noise,
            budget=self.budget - self.spent,
            parallelism=self.cases.parallelism,
            progress=self.step.progress,
            better=better,
        )
        self.spent += minimal.trials
        return minimal

    def _known(self) -> Noise:
        """Return what is known of the rates of parts of the log: nothing if their whole has several possible causes."""
        if len(self.log.originals) > 1:
            return Noise.after(nominal_total=nominal_passes(self.finding))
        return noise_of(self.finding)

    def _simplified(self, found: _Found) -> _Found:
        """Return the result with values as simple as possible, and without messages that are no longer needed."""
        if not self.paced:
            # it is fed as fast as the unit takes it, so its timestamps do not matter: a millisecond apart
            found = replace(found, log=spaced(found.log, [1_000_000] * (len(found.log.messages) - 1)))
        if not found.minimal.one_minimal:
            return found
        spent, nominal = self.spent, self.step.workspace.known_unit_log(self.finding.unit)

        def better(log: FailingLog) -> None:
            done = tuple(work.records)
            self.best = replace(found, log=log, simplified=done, simplified_trials=self.spent - spent)

        work = Simplification(
            found.log,
            self.ask,
            registry=self.context.registry,
            paced=self.paced,
            observed=lambda fields: observed_in(nominal, fields.fields.values(), registry=self.context.registry),
            better=better,
        )
        noise = work.run(
            noise=found.minimal.noise,
            budget=self.budget - self.spent,
            parallelism=self.cases.parallelism,
            progress=self.step.progress,
        )
        self.spent += work.trials
        if not work.records:
            return replace(found, simplified_trials=work.trials)
        simpler = replace(
            found,
            log=work.log,
            minimal=replace(found.minimal, noise=noise),
            simplified=tuple(work.records),
            simplified_trials=work.trials,
        )
        try:
            minimal = self._shrunk(work.log, within=simpler)
        except InconclusiveError:  # chance has led the search to messages that do not fail
            return replace(found, simplified_trials=work.trials)
        if not minimal.one_minimal:  # proven minimality is worth more than simpler values
            return found
        return simpler.reduced(work.log, minimal)

    def _rated(self, found: _Found) -> _Found:
        """Return the result with its failure rate in fresh trials, unless it always fails.

        The trials of the search overestimate the rate: messages were kept because they failed. If at the true one the
        trials do not tell that every message is needed, it is searched for such that are not.

        Raises:
            InconclusiveError: None of the fresh trials failed.
        """
        failed, total = found.minimal.failed
        always = failed == total and found.minimal.noise.rate > 0.95  # an estimate
        if always and len(self.log.originals) < 2:
            return found
        failed = total = 0
        if always:  # so the whole log does, which has several modified messages: as many chances to fail
            total = min(4, self.budget - self.spent)  # a rate of 0.3 passes for always once in 123 times
            failed = sum(self._failing([found.log] * total))
            if failed == total:
                self.spent += total
                return replace(found, minimal=replace(found.minimal, failed=(failed, total))) if total else found
        at_once = [found.log] * self.cases.parallelism
        most = self.budget - self.spent - total
        failed, total = measured_rate(lambda: self._failing(at_once), failed=failed, total=total, most=most)
        self.spent += total
        if total >= FEWEST and not failed:
            raise InconclusiveError(
                f"none of {total} fresh trials of what was kept, {counted(len(found.kept), 'message')}, failed: "
                "the failure comes so seldom that chance has led the search",
                where=str(self.folder),
                hint="try another --seed; what makes it come more often?",
            )
        if not failed:  # the budget is spent: too few trials to say that it does not fail, or that it does
            return replace(found, minimal=replace(found.minimal, one_minimal=False, confidence=0.0)) if total else found
        noise = Noise.after(failed, total, nominal_total=nominal_passes(self.finding))
        rated = replace(found.minimal, failed=(failed, total), noise=noise)
        if rated.one_minimal and rated.doubt > 1 - CONFIDENCE:
            rated = replace(rated, one_minimal=False, confidence=0.0)
            try:
                minimal = self._shrunk(found.log, within=replace(found, minimal=rated))
                if minimal.one_minimal and len(minimal.kept) < len(found.kept):
                    return self._rated(found.reduced(found.log, minimal))
            except InconclusiveError:  # chance has led one of the searches, and it is not known which
                return replace(found, minimal=rated)
            if minimal.one_minimal:
                rated = replace(minimal, failed=(failed, total))
        return replace(found, minimal=rated)

    def _without_modified(self, found: _Found) -> _Found:
        """Return the result with trials without its modified messages: their absence may have the same effect."""
        log, without = found.log, list(found.minimal.without)
        rest = [place for place, message in enumerate(log.messages) if message.sequence not in log.originals]
        if not self.needs_cause or not log.originals or not rest or self.missing:
            return found
        failed, total, fails = self._decided(log.keep(rest), found.minimal.noise)
        if fails:
            self._tell_other_cause(log.keep(rest), (failed, total))
        if len(without) == len(rest) + 1:
            (modified,) = set(range(len(without))).difference(rest)
            without[modified] = failed, total
        return replace(found, minimal=replace(found.minimal, without=tuple(without)))

    def _tell_other_cause(self, log: FailingLog, failed: tuple[int, int]) -> None:
        topics = (self.context.registry.topic(message.key) for message in log.messages)
        self.missing, self.missing_failed = tuple(dict.fromkeys(topics)), failed
        write_other_cause(self.step, self.folder, self.finding, log, failed)

    def _absent(self, found: _Found) -> AbsentRecord | None:
        """Return which messages are missing, if that is why it fails."""
        if not self.nominal_passes or found.log.originals:
            return None
        noise, unprobed = found.minimal.noise, self.unprobed
        return absent_messages(self.step, self.finding, found.log, self.cases, noise, unprobed=unprobed)

    def _failing(self, logs: Sequence[FailingLog]) -> list[bool]:
        workspace, finding = self.step.workspace, self.finding
        asked = [unit_case(workspace, finding, one.messages, unprobed=self.unprobed) for one in logs]
        return self.cases.failures(asked, finding.signature)

    def _failing_if_modified(self, logs: Sequence[FailingLog]) -> list[bool]:
        """Return for each log whether it fails, but not with the originals of its modified messages."""
        answers = self._failing(logs)
        failed = [log.restored() for log, answer in zip(logs, answers, strict=True) if answer]
        unmodified = iter(self._failing(failed))
        return [answer and not next(unmodified) for answer in answers]

    def _decided(self, log: FailingLog, noise: Noise) -> tuple[int, int, bool]:
        """Return the failed and total trials of a log presumed harmless, and whether it triggers the failure."""
        failed = total = 0
        chance = _UNMODIFIED
        while total < 1 or _DOUBT < chance < 1 - _DOUBT:
            failed, total = failed + sum(self._failing([log])), total + 1
            chance = noise.triggers(failed, total - failed, prior=_UNMODIFIED)
        self.spent += total
        return failed, total, chance > 0.5

    def _saved(self, found: _Found, absent: AbsentRecord | None = None) -> MinimalRecord:
        """Write `minimal.mcap` and return its record."""
        metadata = self.finding.provenance | {"seed": str(self.step.workspace.seed)}
        found.log.save(self.folder / "minimal.mcap", context=self.context, metadata=metadata)
        minimal = found.minimal
        return MinimalRecord(
            before=len(self.log.messages),
            kept=found.kept,
            topics=tuple(self.context.registry.topic(message.key) for message in found.log.messages),
            one_minimal=minimal.one_minimal,
            confidence=minimal.confidence,
            failed=minimal.failed,
            without=minimal.without,
            missing=self.missing,
            missing_failed=self.missing_failed,
            simplified=found.simplified,
            simplified_trials=found.simplified_trials,
            absent=absent,
            unprobed=self.unprobed,
            added=self.added,
        )
