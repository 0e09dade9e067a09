"""Grades what riot says about a case by the truth of the case, without asking riot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.real_faults.case import Case, inputs_of, messages_of
from riot_bus.chain.unit.prediction import predict
from riot_bus.findings.records import CampaignRecord, FieldsRecord, FindingRecord, MinimalRecord, RuleRecord
from riot_bus.generalize.rule import Rule
from riot_bus.log.reader import read_log
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message

POINTS = 5_000
"""Inputs near the limits of the truth and far away on which a rule is tried."""

MONITORS = {"crash": ("crash", "exit"), "hang": ("hang",), "silent": ("silent", "answered"), "nan": ("mined", "finite")}
"""Monitors that see a symptom; what is wrong can be seen by any."""

GOOD = 0.95
"""Least balanced accuracy of a rule about which riot says nothing bad."""


@dataclass(slots=True)
class GradedFinding:
    """One finding, sorted, with its rule and what is wrong with what is said.

    Attributes:
        sort: `known`: the report's fault; `other`: another one, seen without riot, too; `own`: the node does not check
            the form of its payloads; `false`: neither truth nor program know of it.
        accuracy: Balanced accuracy of the rule; None without a rule.
        wrong: Claims that the truth contradicts.
    """

    id: str
    signature: str
    sort: str
    messages: int
    rule: str = ""
    accuracy: float | None = None
    wrong: list[str] = field(default_factory=list)


@dataclass(slots=True)
class Grade:
    """What riot found out about a case; `met` says whether the report's fault is among the findings."""

    met: bool
    trials: int
    tried: int
    coverable: int
    findings: list[GradedFinding]
    wrong: list[str]


def grade(case: Case, out: Path, *, twin: bool = False, points: int = POINTS) -> Grade:
    """Grade an output folder of `riot test` and `riot analyze`, of the program or its twin."""
    campaign = CampaignRecord.load(out)
    folders = sorted(path.parent for path in out.glob("findings/*/finding.json"))
    findings = [_graded(case, folder, twin=twin, points=points) for folder in folders]
    met = any(each.sort == "known" for each in findings)
    wrong = []
    if case.has_truth and not met and not twin and campaign.covered == campaign.coverable:
        wrong.append(f"{campaign.covered} of {campaign.coverable} tried, and not met")
    return Grade(met, campaign.tested, campaign.covered, campaign.coverable, findings, wrong)


def _graded(case: Case, folder: Path, *, twin: bool, points: int) -> GradedFinding:
    finding, minimal = FindingRecord.load(folder), folder / "minimal.mcap"
    messages = read_log(minimal if minimal.exists() else folder / "failure.mcap")
    played = case.followed(messages)
    sort: str = case.verdict(played)[0] or "false"
    if sort == "known" and finding.monitor not in MONITORS.get(case.file.symptom, (finding.monitor,)):
        sort = "other"  # its log has the report's inputs, too, but this is another failure
    found = GradedFinding(finding.id, finding.signature, "false" if twin and sort == "known" else sort, len(messages))
    if found.sort == "false":
        (run,) = case.run([inputs_of(played)], twin=twin)
        if run.end != "passed" or case.shows(inputs_of(played), run):
            found.sort = "other"
    if found.sort == "known":
        rate, chance = finding.rate, case.file.chance
        if rate is not None and not rate.low <= chance <= rate.high:
            found.wrong.append(f"fails in {rate.low:.2f} to {rate.high:.2f} of trials, truth: {chance:.2f}")
        found.wrong += _wrong(case, folder, messages)
        if RuleRecord.exists(folder):
            _grade_rule(case, RuleRecord.load(folder), found, points)
    return found


def _wrong(case: Case, folder: Path, messages: Sequence[Message]) -> Iterator[str]:
    """Yield claims about the minimal log and the fields that the truth contradicts."""
    record = MinimalRecord.find(folder)
    if record is not None and record.one_minimal:
        for number, message in enumerate(messages):
            if case.verdict(case.followed([*messages[:number], *messages[number + 1 :]]))[0]:
                yield f"minimal, but fails without message {number} ({message.key}), too"
    if not FieldsRecord.exists(folder):
        return
    for each in FieldsRecord.load(folder).fields:
        for name, fails in ((each.certificate.failing_log, True), (each.certificate.passing_log, False)):
            if bool(case.verdict(case.followed(read_log(folder / name)))[0]) is not fails:
                yield f"{each.name} matters, but {name} {'passes' if fails else 'fails'}"


def _grade_rule(case: Case, record: RuleRecord, found: GradedFinding, points: int) -> None:
    rule, registry = Rule.from_json(record.rule), TypeRegistry()
    right = {True: [0, 0], False: [0, 0]}
    for log in case.draws(points, seed=1):
        fails = case.fails(log)
        said = predict(rule, record.topics, messages_of(log), registry=registry, at_most=1, keeps=record.keeps)
        right[fails][0] += bool(said.would_fail) is fails
        right[fails][1] += 1
    found.rule = record.text
    found.accuracy = sum(hits / max(1, count) for hits, count in right.values()) / 2
    if found.accuracy < GOOD and not record.shortcomings:
        found.wrong.append(f"the rule is said without a doubt, balanced accuracy {found.accuracy:.2f}")
