"""The files of a finding: versioned JSON for knowledge, MCAP for logs.

finding.json       what failed, how it was found
failure.mcap       the failing log as found: modified and unmodified messages with provenance
minimal.json/.mcap the few messages that are needed
fields.json        relevant fields, each with its two-trial certificate
rule.json          the rule in one line, and as data; sanitize.py, sanitize.hpp
permeability.json  which external fields reach the relevant ones
activation.json/.mcap  the external messages that make the whole system fail, and the region around them
region/rule.json   that region as a rule over external fields
report.html, reproduce.sh, riot_test_ID.py
"""

from __future__ import annotations

import json
import logging
import os
from pathlib import Path
from typing import Any, ClassVar, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from riot_bus.given_files import given_folder, given_text, leads_out
from riot_bus.new_file import write_whole
from riot_bus.statistics.rates import Proportion
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.trial import SEVERITIES

_LOG = logging.getLogger(__name__)
RecordT = TypeVar("RecordT", bound="Artefact")

Value = bool | int | float | str

_LONGEST, _MOST_TOLD = 40, 8
"""Most characters of a value, and most names, in a line for people; the file has all."""


def _short(value: Value | None) -> str:
    """Return a value as text, shortened for a line."""
    text = json.dumps(value, ensure_ascii=False) if isinstance(value, str) else str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}... ({len(text)} characters)"


class _Model(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class Artefact(_Model):
    """One JSON file of a finding.

    Attributes:
        FILE: Name of the file.
        STEP: The command that writes it.
    """

    FILE: ClassVar[str]
    STEP: ClassVar[str] = "analyze"
    version: Literal[1] = 1
    seed: int = 0
    trials: int = 0
    seconds: float = 0.0

    @property
    def summary(self) -> str:
        """Result of the step, in a line for people."""
        return ""

    def save(self, directory: Path) -> Path:
        """Write the file in one step, so that a reader never sees half of it."""
        path = directory / self.FILE
        write_whole(path, json.dumps(self.model_dump(mode="python"), indent=1, default=str) + "\n")
        return path

    @classmethod
    def load(cls, directory: Path) -> Self:
        """Read the file.

        Raises:
            ConfigError: It is missing, not what this version writes, or a link out of the folder.
        """
        path = directory / cls.FILE
        try:
            return cls.model_validate(json.loads(given_text(path, inside=directory)))
        except FileNotFoundError:
            raise ConfigError(
                f"{cls.FILE} does not exist yet", where=str(directory), hint=f"run `riot {cls.STEP}` first"
            ) from None
        except (OSError, ValueError, ValidationError, RecursionError) as error:
            raise ConfigError(
                f"this file cannot be used: {str(error).splitlines()[0]}",
                where=str(path),
                hint=f"delete it and run `riot {cls.STEP}` again",
            ) from None

    @classmethod
    def exists(cls, directory: Path) -> bool:
        """Return whether the step that writes this file has finished."""
        return (directory / cls.FILE).is_file()

    @classmethod
    def find(cls, directory: Path) -> Self | None:
        """Read the file if the step that writes it has finished; return None if not."""
        return cls.load(directory) if cls.exists(directory) else None


class ProportionRecord(_Model):
    """A rate with its Clopper-Pearson 95 % interval."""

    value: float
    low: float
    high: float
    count: int = 0
    total: int = 0

    @classmethod
    def of(cls, rate: Proportion) -> Self:
        """Return the record of a rate."""
        return cls(value=rate.rate, low=rate.low, high=rate.high, count=rate.hits, total=rate.total)


class EffectsRecord(_Model):
    """Effects of a campaign's injections, and how many of the tried values and faults failed alone.

    Attributes:
        undelivered: Injections that changed no message; all other counts are of injections that changed some.
        without_effect: Injections in passing trials with the outputs of the nominal trials, by count and payload.
        with_effect: Injections in passing trials with other outputs.
        untold: Injections in passing trials whose outputs cannot be compared.
        failing: Injections in failing trials.
        topics: Share of the values, mutations and message faults that failed alone, by topic.
        classes: The same share by type of the field, or kind of fault.
        undecided: Number of those that failed only together with others, by topic; the shares leave them out.
    """

    injections: int = 0
    undelivered: int = 0
    without_effect: int = 0
    with_effect: int = 0
    untold: int = 0
    failing: int = 0
    topics: dict[str, ProportionRecord] = {}
    classes: dict[str, ProportionRecord] = {}
    undecided: dict[str, int] = {}

    def lines(self) -> list[str]:
        """Return the effects as lines for people."""
        if not self.injections:
            return []
        found = [
            f"{counted(self.injections, 'injection')}: {self.undelivered} changed no message, {self.without_effect} "
            f"changed messages but no output, {self.with_effect} were in passing trials with other outputs, "
            f"{self.failing} in failing trials, {self.untold} had an unknown effect; "
            "whether the changed messages were read is not known"
        ]
        by_class = self.classes if self.undecided else {}  # which classes those belong to is not known
        for title, many, rates, open_ in (
            ("topic", "topics", self.topics, self.undecided),
            ("field class", "field classes", self.classes, by_class),
        ):
            failed = {name: one for name, one in rates.items() if one.count}
            for name, one in sorted(failed.items(), key=lambda item: (-item[1].value, item[0])):
                share = "" if name in open_ else f", 95 %: {one.low:.1%} to {one.high:.1%}"
                found.append(f"tried on {title} {name}: {one.count} of {one.total} failed alone{share}")
            rest = [one for name, one in rates.items() if name not in failed]
            if rest:
                doubtful = any(name in open_ for name in rates if name not in failed)
                share = "" if doubtful else f", 95 %: at most {max(one.high for one in rest):.1%} of each"
                others = f"{len(rest)} {'other ' if failed else ''}{title if len(rest) == 1 else many}"
                found.append(f"tried on {others}: 0 of {sum(one.total for one in rest)} failed alone{share}")
        if self.undecided:
            topics = ", ".join(f"{count} on {name}" for name, count in sorted(self.undecided.items())[:_MOST_TOLD])
            topics += ", ..." if len(self.undecided) > _MOST_TOLD else ""
            found.append(
                f"failed only together with others, so that no share is known there: {topics}; "
                "`riot test --covered` tells these apart"
            )
        return found


class UnconfirmedRecord(_Model):
    """A failure that only `hits` of `repeats` fresh trials reproduced: chance, or too rare to tell."""

    signature: str
    details: tuple[str, ...] = ()
    occurrences: int = 1
    hits: int = 0
    repeats: int = 0
    injections: tuple[dict[str, Any], ...] = ()


class UnjudgedRecord(_Model):
    """Injected trials that could not be judged for the same reason, and the injections of the one with the fewest."""

    detail: str
    occurrences: int = 1
    injections: tuple[dict[str, Any], ...] = ()

    def __str__(self) -> str:
        return f"{counted(self.occurrences, 'test case')} could not be judged: {self.detail}"


class CampaignRecord(Artefact):
    """A finished campaign, in the output folder: what it found, the worst first.

    Attributes:
        system_file: Path of riot.toml; empty in older records.
        tested: Trials of the nominal log and injected ones, of which `failing` failed; repeated ones are not counted.
        unjudged: Injected trials that are not counted there, because they could not be judged.
        notes: Remarks of monitors about themselves, such as that they saw nothing, and in how many trials.
        ordered: Whether trials kept the order of the log across topics.
        started: Way in which trials started the unit: "forked" or "executed", and why not forked.
        covered: Values of fields, mutations and message faults that were delivered in a trial that tells of them.
        coverable: Number of existing pairs of field and value class.
        untold: Questions that could not be decided about the unit's trials, and why.
        rate: Share of the tested trials of the component that failed.
        mined: Rules mined from nominal trials, from how many, and in how many others (`held_out`) one fired.
        whole_system: Whether trials were runs of the whole system, with injections into its external inputs.
        stopped: Reason why it ended before its budget was spent; empty if it did not.
    """

    FILE = "campaign.json"
    STEP = "test"
    unit: str
    fingerprint: str
    failing: int = 0
    tested: int = 0
    findings: tuple[str, ...] = ()
    unconfirmed: tuple[UnconfirmedRecord, ...] = ()
    unjudged: tuple[UnjudgedRecord, ...] = ()
    notes: dict[str, int] = {}
    ordered: bool = False
    started: str = ""
    covered: int = 0
    coverable: int = 0
    effects: EffectsRecord = EffectsRecord()
    untold: tuple[str, ...] = ()
    rate: ProportionRecord | None = None
    mined: dict[str, Any] = {}
    whole_system: bool = False
    stopped: str = ""
    system_file: str = ""

    @property
    def doubts(self) -> list[str]:
        """Why a campaign without findings proves nothing; empty if it is clean."""
        return [*self.notes, *map(str, self.unjudged)]


class FindingRecord(Artefact):
    """One distinct failure of a unit.

    Attributes:
        system_file: Path of riot.toml; one that begins with `../` is relative to the folder of the finding.
        fingerprint: Hash of what was tested: the system file and the code.
        severity: Its place on the CRASH scale.
        rate: Failure rate of fresh trials of its test case.
        nominal: Rate of this failure in trials of the nominal log.
        ordered: Whether its trials keep the order of the log across topics.
        delivered: Number of played messages that each of `injections` changed; empty if not known.
        external: Whether the system names external topics; else the chain ends with the rule.
        whole_system: Whether it was found in runs of the whole system; then its log has the external messages.
        malformed: Whether only payloads that a sender that works would not send have caused it, and it is told with the
            others of these.
        fixed_in: Fingerprint of other code with which fresh trials of it did not fail; empty if that was not seen.
    """

    FILE = "finding.json"
    STEP = "test"
    id: str
    system: str
    system_file: str
    unit: str
    component: str
    monitor: str
    signature: str
    details: tuple[str, ...] = ()
    fingerprint: str = ""
    severity: str = ""
    rate: ProportionRecord | None = None
    nominal: ProportionRecord | None = None
    ordered: bool = False
    occurrences: int = 1
    injections: tuple[dict[str, Any], ...] = ()
    delivered: tuple[int, ...] = ()
    messages: int = 0
    modified: int = 0
    external: bool = True
    whole_system: bool = False
    malformed: bool = False
    fixed_in: str = ""

    @classmethod
    def load(cls, directory: Path) -> Self:
        """Read the file; a path relative to the finding's folder becomes an absolute one.

        Raises:
            ConfigError: As of any record; or the folder holds links that lead out of it, pipes or the like.
        """
        record = super().load(given_folder(directory))
        if not record.system_file.startswith("../"):
            return record
        whole = os.path.normpath(directory.absolute() / record.system_file)
        return record.model_copy(update={"system_file": whole})

    @classmethod
    def folders(cls, findings: Path) -> list[Path]:
        """Return the folders of all findings in a folder, sorted; where a link leads out of it, a warning instead."""
        found = {path: leads_out(path, findings.parent) for path in sorted(findings.glob(f"*/{cls.FILE}"))}
        for path in (path for path, out in found.items() if out):
            _LOG.warning("riot: %s is left out: this link leads out of %s", path.parent, findings.parent)
        return [path.parent for path, out in found.items() if not out]

    @property
    def provenance(self) -> dict[str, str]:
        """Metadata of its logs."""
        return {"finding": self.id, "signature": self.signature}

    @property
    def rank(self) -> tuple[bool, int, float, int]:
        """Sort key among findings: first those worse on the CRASH scale, more frequent, with fewer modifications.

        Those of malformed payloads come last.
        """
        place = SEVERITIES.index(self.severity) if self.severity in SEVERITIES else len(SEVERITIES)
        return self.malformed, place, -self.rate.value if self.rate else 0.0, self.modified


class SimplifiedRecord(_Model):
    """A simplification of the minimal log that kept the failure.

    Attributes:
        what: `gap` (the time between two messages, in seconds), `nominal` (a modified field, or without values a whole
            payload, is as it was before), or `value` (a modified field has a simpler value).
        before: Value with which it first failed; None for payloads.
    """

    what: Literal["gap", "nominal", "value"]
    name: str
    before: Value | None = None
    after: Value | None = None

    def __str__(self) -> str:
        if self.what == "gap":
            shorter = "; shorter times that were tried pass" if self.after else ""
            return f"{self.name}: {self.before:g} s -> {self.after:g} s{shorter}"
        if self.before is None:
            return f"{self.name}: as it was recorded"
        return f"{self.name}: {_short(self.before)} -> {_short(self.after)}" + (
            " (nominal)" if self.what == "nominal" else ""
        )


class AbsentRecord(_Model):
    """Messages of the nominal log whose absence from the minimal log makes it fail.

    Attributes:
        numbers: Their positions in the nominal log of the unit.
        passed: Passing trials, and trials in total, of the minimal log with all of them; with any or all of them
            missing, it fails.
    """

    numbers: tuple[int, ...]
    topics: tuple[str, ...]
    passed: tuple[int, int]

    def __str__(self) -> str:
        which = zip(self.topics, self.numbers, strict=True)
        names = ", ".join(f"{topic} (number {number} of the nominal log)" for topic, number in which)
        passed, total = self.passed
        verb, them = ("is", "it") if len(self.numbers) == 1 else ("are", "them")
        return f"fails since {names} {verb} missing: with {them}, {passed} of {counted(total, 'trial')} passed"


class MinimalRecord(Artefact):
    """The few messages that are needed (RIOT II-B a).

    Attributes:
        one_minimal: Whether it was shown that they fail, and that they do not without any single one of them.
        confidence: Lower bound of the confidence in that; 0 if it was not shown.
        failed: Failing trials of these messages, and trials in total.
        without: The same for each message, when it alone was left out; (0, 0) if that leaves no message. A failure
            without the modified message has another cause: see `missing`.
        interrupted: Whether the search was interrupted; then this is the best so far, and `riot minimize` continues.
        missing: Topics of unmodified messages that fail in the same place because others are missing;
            `missing_failed` has their failing trials and trials in total. They are a finding of their own.
        absent: Missing messages of the nominal log, if none of the kept messages is modified and the nominal log
            passes.
        unprobed: Whether trials of these messages, and of those with other values, had no others: no probe followed.
            Else a probe has a part in the failure, or alone shows it.
        added: Number of nominal messages that were added to the end of the failing log, which does not fail without;
            `before` and `kept` count them, too.
    """

    FILE = "minimal.json"
    STEP = "minimize"
    before: int
    kept: tuple[int, ...]
    topics: tuple[str, ...]
    one_minimal: bool
    confidence: float = 0.0
    failed: tuple[int, int] = (0, 0)
    without: tuple[tuple[int, int], ...] = ()
    interrupted: bool = False
    missing: tuple[str, ...] = ()
    missing_failed: tuple[int, int] = (0, 0)
    simplified: tuple[SimplifiedRecord, ...] = ()
    simplified_trials: int = 0
    absent: AbsentRecord | None = None
    unprobed: bool = False
    added: int = 0

    def lines(self) -> list[str]:
        """Return lines for people: how the kept messages were simplified, and what else fails in the same way."""
        found = [f"simplified: {one}" for one in self.simplified]
        found += [f"it {self.absent}"] if self.absent else []
        later = sum(place >= self.before - self.added for place in self.kept)
        if later:
            found.append(f"nominal, after the end of the log: the last {later} of these messages")
        if self.missing:
            failed, total = self.missing_failed
            names = ", ".join(dict.fromkeys(self.missing))
            found.append(f"another cause: {names} alone, unmodified, failed in {failed} of {counted(total, 'trial')}")
        return found

    @property
    def summary(self) -> str:
        """How many messages are needed, and of which topics."""
        needed = ", ".join(self.topics) or "none (it fails without any input)"
        proven = "" if self.one_minimal else ", not proven to be minimal"
        other = f"; {', '.join(self.missing)} alone, unmodified, fails likewise" if self.missing else ""
        kept = f"{counted(self.before, 'message')} -> {len(self.kept)}: {needed}"
        values = ", ".join(str(one) for one in self.simplified if one.what == "value")
        back = sum(one.what == "nominal" for one in self.simplified)
        gaps = sum(one.what == "gap" for one in self.simplified)
        simpler = "; " * bool(values) + values + (f"; {back} back to nominal" if back else "")
        simpler += f"; {counted(gaps, 'shorter gap')}" if gaps else ""
        simpler += f"; {self.absent}" if self.absent else ""
        return f"{kept} ({counted(self.trials, 'trial')}{proven}){simpler}{other}"

    @classmethod
    def exists(cls, directory: Path) -> bool:
        """Return whether the search has ended; the result of an interrupted search does not count."""
        if not super().exists(directory):
            return False
        try:
            return not cls.load(directory).interrupted
        except ConfigError:
            return True  # the file exists, and reading it reports what is wrong with it


def shortest_log(directory: Path) -> Path:
    """Return the path of the log that shows a finding: the minimal log, or the failing log while there is none."""
    return directory / ("minimal.mcap" if MinimalRecord.exists(directory) else "failure.mcap")


class CertificateRecord(_Model):
    """Two trials that differ in one field: the log with `failing` fails, with `passing` it does not.

    `confirmed_failing` of `repeats` fresh trials of the failing side failed, `confirmed_passing` of `passing_repeats`
    of the passing side did not (of `repeats` too in older files).
    """

    failing: Value
    passing: Value
    others: dict[str, Value] = {}
    failing_log: str
    passing_log: str
    confirmed_failing: int
    confirmed_passing: int
    repeats: int
    passing_repeats: int = 0

    @property
    def passing_total(self) -> int:
        """Fresh trials of the passing side."""
        return self.passing_repeats or self.repeats


class FieldRecord(_Model):
    """One relevant field: the value that fails in its certificate is an exceptional one, or a nominal one."""

    name: str
    kind: Literal["exceptional", "nominal"]
    type: str
    failing: Value
    certificate: CertificateRecord


class StructureRecord(_Model):
    """A property of the minimal log, other than a value, that the failure needs: two logs that differ only in it.

    Attributes:
        kind: `key` (it is there), `missing key`, `no value` (null, or an empty list or map, where there was one),
            `order` (one message is before the next), or `gap` (the next one comes no later than it does).
        then: The message that comes after it.
        passing_log: Log that passes, with only this property changed.
        failed: Failing ones, and all, of the fresh trials of the failing log.
        passed: Passing ones, and all, of the fresh trials of the passing log.
    """

    kind: Literal["key", "missing key", "no value", "order", "gap"]
    name: str
    then: str = ""
    failing_log: str
    passing_log: str
    failed: tuple[int, int]
    passed: tuple[int, int]

    def __str__(self) -> str:
        return {
            "key": f"{self.name} is there",
            "missing key": f"{self.name} is missing",
            "no value": f"{self.name} has no value (missing, null or empty)",
            "order": f"{self.name} comes before {self.then}",
            "gap": f"{self.then} comes soon after {self.name}",
        }[self.kind]


class FieldsRecord(Artefact):
    """Relevant fields (RIOT II-B b).

    Attributes:
        bound: With 95 % confidence, the other fields change the outcome in at most this share of random draws.
        straight: Number of consecutive draws behind that bound, none of which changed the outcome.
        unconfirmed: Fields that the search named, but whose certificate fresh trials did not confirm.
        complete: Whether the search ended by itself, not because its trials were spent.
        structure: Properties other than values that the failure needs.
        structure_known: Number of parts, by kind, of which it is known whether they matter; 0 if trials did not tell.
        structure_failed: Failing trials, and trials in total, with all other parts of a kind changed at once.
        left: Fields that were not varied: brittle ones, and those that riot.toml leaves alone.
    """

    FILE = "fields.json"
    STEP = "relevance"
    fields: tuple[FieldRecord, ...]
    considered: tuple[str, ...]
    bound: float
    straight: int
    unconfirmed: tuple[str, ...] = ()
    complete: bool = True
    structure: tuple[StructureRecord, ...] = ()
    structure_known: dict[str, int] = {}
    structure_failed: tuple[int, int] = (0, 0)
    left: tuple[str, ...] = ()

    @property
    def summary(self) -> str:
        """Which fields matter."""
        kinds = {one.name: one.kind for one in self.fields} | dict.fromkeys(self.unconfirmed, "unconfirmed")
        names = ", ".join(f"{name} ({kind})" for name, kind in kinds.items()) or "none"
        spent = "" if self.complete else "; trials spent before the search had ended"
        needed = "".join(f"; it needs that {one}" for one in self.structure)
        sure = f"at most {self.bound:.1%} of random values of the others change the outcome (95 %)"
        rest = f"; {sure if self.straight else 'whether the others matter is not known'}"
        needed += rest if len(self.considered) > len(kinds) else ""
        return f"{counted(len(self.considered), 'field')} -> {names} ({counted(self.trials, 'trial')}{spent}){needed}"


class RuleSample(_Model):
    """One trial of the search for a rule."""

    values: dict[str, Value]
    failed: bool
    phase: str = ""


class AlternativeRecord(_Model):
    """Another rule that explains all trials equally well, and values for which the two disagree."""

    text: str
    rule: dict[str, Any]
    decided_by: dict[str, Value]


_RIGHT, _RIGHT_ELSEWHERE = 0.98, 0.8
"""Shares of trials in which a rule should be right: of ordinary ones, within their confidence interval, and of the few
with other values of all fields that are not in the rule."""


class RuleRecord(Artefact):
    """Rule that says when a failure occurs (RIOT II-B c); in `region/rule.json` it is over external fields.

    Attributes:
        topics: Topic of each message of the log in which its fields are named.
        context: Topics of the nominal messages before the minimal log that matter; that log is `context.mcap`.
        in_context: Share of the trials that start with nominal messages in which the rule is right.
        in_campaign: Share of the campaign's trials in which the rule is right; those that failed in another way and
            those of `unjudged` are left out, and if the failure occurs only sometimes, also passing ones in which the
            rule holds.
        held: Numbers, if the failure occurs only sometimes: failing ones, and all, of the campaign's trials in which
            the rule holds.
        missed: Number of the campaign's trials with this failure in which the rule holds nowhere.
        unjudged: Number of the campaign's trials in which the rule holds nowhere, but a message lacks a field of it
            that decides whether it does.
        keeps: Whether a message that lacks a field leaves its earlier value in force, as trials of the campaign show;
            otherwise the field is not known.
    """

    FILE = "rule.json"
    STEP = "rules"
    text: str
    rule: dict[str, Any]
    legend: tuple[str, ...] = Field(default=(), description="names of its values and units of its fields, if known")
    python: str = Field(default="", description="a predicate over a dict of its fields")
    precision: ProportionRecord
    recall: ProportionRecord
    balanced_accuracy: float | None = Field(description="null unless some fresh trials failed and some passed")
    checks: int = Field(default=0, description="fresh trials behind these rates")
    topics: tuple[str, ...] = ()
    context: tuple[str, ...] = ()
    in_context: ProportionRecord | None = None
    in_campaign: ProportionRecord | None = None
    missed: int = 0
    held: tuple[int, int] = (0, 0)
    unjudged: int = 0
    keeps: bool = False
    varied_mistakes: int = Field(default=0, description="number of `varied_checks` that it predicts wrongly")
    varied_checks: int = Field(default=0, description="fresh trials with other nominal values of all other fields")
    own_mistakes: int = Field(
        default=0, description="number of `samples` that it predicts wrongly, without those of the phase `context`"
    )
    own_mistake: dict[str, Value] = Field(default={}, description="values of its fields in the first of these")
    alternatives: tuple[AlternativeRecord, ...] = ()
    scale: dict[str, float] = Field(description="nominal spread of each field, in its unit: the unit of distances")
    types: dict[str, str] = Field(default={}, description="type of each field, such as float64")
    stl: str = Field(default="", description="as a formula of signal temporal logic")
    stl_signals: dict[str, str] = Field(default={}, description="field of each signal of the formula")
    stl_missing: str = Field(default="", description="why there is no formula")
    samples: tuple[RuleSample, ...] = ()

    @property
    def shortcomings(self) -> str:
        """Where the rule was seen to be wrong, or was not tested, in a few words; empty if nowhere."""
        asked = ((self.in_campaign, "of the campaign"), (self.in_context, "that start with nominal messages"))
        found = [
            f"right in only {one.count} of {counted(one.total, 'trial')} {where}"
            for one, where in asked
            if one is not None and one.total and one.high < _RIGHT
        ]
        if self.varied_mistakes > self.varied_checks * (1 - _RIGHT_ELSEWHERE):
            checks = counted(self.varied_checks, "check")
            found.append(f"wrong in {self.varied_mistakes} of {checks} with other values of all other fields")
        if self.own_mistakes:
            values = ", ".join(f"{name} = {value}" for name, value in self.own_mistake.items())
            found.append(f"wrong in {self.own_mistakes} of the trials that it was learnt from: {values}")
        if not found and self.balanced_accuracy is None:
            found.append("tested with one outcome only" if self.checks else "not tested")
        return "; ".join(found)

    @property
    def summary(self) -> str:
        """The rule, and how well it predicts."""
        failing = self.recall.total
        # a rule over booleans has so few cases that being right in all of them says little
        few = self.types and set(self.types.values()) == {"bool"}
        cases = f" of its {2 ** len(self.types)} cases" if few else ""
        if 0 < failing < self.checks and self.balanced_accuracy is not None:
            checks = counted(self.checks, "fresh check")
            accuracy = f"balanced accuracy {self.balanced_accuracy:.3f} on {checks}{cases}"
        elif self.checks:
            accuracy = f"tested with one outcome only: {failing} of {counted(self.checks, 'fresh check')} failed"
        else:
            accuracy = "not tested: no fresh checks were possible"
        if self.in_context is not None and self.in_context.total:
            one = self.in_context
            accuracy += f", right in {one.count} of {counted(one.total, 'trial')} that start with nominal messages"
        if self.in_campaign is not None and self.in_campaign.total:
            one = self.in_campaign
            accuracy += f" and {one.count} of {one.total} of the campaign"
            accuracy += f", of which {self.missed} failed though it does not hold" if self.missed else ""
            failed, held = self.held
            accuracy += f"; {failed} of {counted(held, 'trial')} in which it holds failed" if held else ""
        if self.unjudged:
            trials = "further trial" if self.in_campaign is not None and self.in_campaign.total else "trial"
            accuracy += f"; {counted(self.unjudged, trials)} of the campaign could not be judged"
        if self.varied_mistakes:
            of = counted(self.varied_checks, "check")
            accuracy += f"; wrong in {self.varied_mistakes} of {of} with other values of all other fields"
        if self.own_mistakes:
            accuracy += f"; wrong in {self.own_mistakes} of the trials that it was learnt from"
        where = f", where {', '.join(self.legend)}" if self.legend else ""
        return f"fails when {self.text}{where} ({accuracy}, {counted(self.trials, 'trial')})"


PLAYED = "whether the outside was the nominal log, which does not answer to what the system does"
