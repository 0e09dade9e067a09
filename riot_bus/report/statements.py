"""Every statement of a report with its evidence, and what was not tried."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.records import FieldsRecord, ProportionRecord, Value
from riot_bus.report.finding_view import FindingView
from riot_bus.report.format import clean, number, plural, share, share_interval
from riot_bus.statistics.rates import exact_interval
from riot_bus.vocabulary.order import order_of

_MOST = 20  # statements of one kind: about a screen
_PARTS = {
    "other keys": ("key", "missing key", "no value"),
    "other orders of neighbours": ("order",),
    "longer times between messages": ("gap",),
}
"""Properties of a log besides values that are tested, and their kinds in the record."""


@dataclass(frozen=True, slots=True)
class Statement:
    """A claim, the evidence for it, and how sure that makes it."""

    claim: str
    evidence: str
    confidence: str


def statements(view: FindingView) -> list[Statement]:
    """Return the claims of the finished steps."""
    return [_failure(view), *_minimal(view), *_fields(view), *_rule(view), *_outside(view)]


def _minimal(view: FindingView) -> Iterator[Statement]:
    minimal = view.minimal
    if minimal is None:
        return
    (failed, total), without = minimal.failed, minimal.without
    left_out = sum(trials for _, trials in without)
    evidence = f"{failed} of {plural(total, 'trial')} of them failed" if total else "no trial of them alone is known"
    if left_out:
        evidence += (
            f"; with one of them left out, {sum(hits for hits, _ in without)} of {plural(left_out, 'trial')} "
            f"({min(trials for _, trials in without if trials)} or more for each)"
        )
    if any(trials == 0 for _, trials in without):
        evidence += "; without the modified one nothing is left"
    confidence = "not proven to be minimal: the search ended before that"
    if minimal.one_minimal:
        sure = f"{share(minimal.confidence)}: " if minimal.confidence else ""
        needed = "of those with a modified one, no fewer do" if minimal.missing else "none of them can be left out"
        confidence = f"{sure}they suffice, and {needed}"
    one = len(minimal.kept) == 1
    what = f"suffice{'s' * one} for the failure" if failed else f"{'was' if one else 'were'} kept"
    if not failed:
        confidence = "not known whether they suffice"
    yield Statement(f"{plural(len(minimal.kept), 'message')} of {minimal.before} {what}", evidence, confidence)
    if minimal.absent:
        passed, trials = minimal.absent.passed
        claim = f"it fails since messages are missing ({_names(dict.fromkeys(minimal.absent.topics))})"
        with_them = f"with {_numbers(minimal.absent.numbers)} of the nominal log"
        evidence = f"{with_them}, {passed} of {plural(trials, 'trial')} passed"
        yield Statement(claim, evidence, "none of them can be left out")
    if minimal.missing:
        hits, trials = minimal.missing_failed
        claim = f"a part of the log fails likewise with nothing modified ({_names(minimal.missing)})"
        sure = "another cause, and a finding of its own: the messages kept fail only when modified"
        yield Statement(claim, f"{hits} of {plural(trials, 'trial')} failed", sure)


def _failure(view: FindingView) -> Statement:
    finding, rate = view.finding, view.finding.rate
    evidence = f"seen in {plural(finding.occurrences, 'trial')} of the test with this signature"
    confidence = "observed" if view.fields is None else "observed; repeated below"
    if rate:
        evidence += f"; {rate.count} of {plural(rate.total, 'fresh trial')} of one of them failed again"
        confidence = f"95 %: fails {share_interval(rate.low, rate.high)} of the time"
    if finding.nominal:
        evidence += f"; {finding.nominal.count} of {plural(finding.nominal.total, 'nominal trial')} failed so"
    return Statement(f"{clean(finding.component)} {view.failure}", evidence, confidence)


def _fields(view: FindingView) -> Iterator[Statement]:
    fields = view.fields
    if fields is None:
        return
    for one in fields.fields[:_MOST]:
        proof = one.certificate
        low, _ = exact_interval(proof.confirmed_failing, proof.repeats)
        clear, _ = exact_interval(proof.confirmed_passing, proof.passing_total)
        sure = f"95 %: fails at least {share(low)} of the time with it, passes at least {share(clear)} without"
        evidence = (
            f"two trials that differ in it alone; {proof.confirmed_failing} of {proof.repeats} failed, "
            f"{proof.confirmed_passing} of {proof.passing_total} passed"
        )
        yield Statement(f"{clean(one.name)} is relevant", evidence, sure if proof.repeats else "one pair of trials")
    for name in fields.unconfirmed[:_MOST]:
        evidence = "fresh trials of its certificate did not confirm it"
        yield Statement(f"{clean(name)} may be relevant", evidence, "unconfirmed")
    for needed in fields.structure[:_MOST]:
        (failed, trials), (passed, others) = needed.failed, needed.passed
        yield Statement(
            f"the failure needs that {clean(str(needed))}",
            f"two logs that differ in this alone; {failed} of {trials} failed, {passed} of {others} passed",
            f"95 %: passes at least {share(exact_interval(passed, others)[0])} of the time otherwise",
        )
    unmoved = {words: sum(_unmoved(fields, kind) for kind in kinds) for words, kinds in _PARTS.items()}
    failed, trials = fields.structure_failed
    if trials and any(unmoved.values()):
        asked = ", ".join(f"{words} ({count} asked)" for words, count in unmoved.items() if count)
        yield Statement(
            f"it fails likewise with {asked}",
            f"all of a kind changed at once: {failed} of {plural(trials, 'trial')} failed",
            f"95 %: fails at least {share(exact_interval(failed, trials)[0])} of the time",
        )
    if rest := other_fields(fields):
        yield rest


def _unmoved(fields: FieldsRecord, kind: str) -> int:
    """Return how many parts of a kind are known not to matter."""
    return fields.structure_known.get(kind, 0) - sum(one.kind == kind for one in fields.structure)


def other_fields(fields: FieldsRecord) -> Statement | None:
    """Return what is known of the fields that were considered and not named; None if there are none."""
    rest = len(fields.considered) - len(fields.fields) - len(fields.unconfirmed)
    if rest < 1:
        return None
    named = f"the {'other ' if rest < len(fields.considered) else ''}{plural(rest, 'field')} of these messages"
    matter = "matters" if rest == 1 else "matter"
    if not fields.straight:
        return Statement(
            f"whether {named} {matter} is not known",
            "the trials were spent before all of them were varied together",
            "not tested",
        )
    ended = "" if fields.complete else "; the trials were spent before the search had ended"
    return Statement(
        f"{named} hardly {matter}",
        f"{plural(fields.straight, 'trial')} in a row with all of them at random values, none changed the "
        f"outcome{ended}",
        f"95 %: of such random values at most {share(fields.bound)} change the outcome",
    )


def _unknown_parts(view: FindingView, fields: FieldsRecord, *, orders: bool) -> list[str]:
    """Return which properties besides values were not tested, or not decided by trials.

    Where some were tested, the log has no keys and orders other than those in the record.
    """
    known = fields.structure_known
    several = view.minimal is None or len(view.minimal.kept) > 1
    there = {"key": not known, "order": several and not orders and not known, "gap": several}
    return [
        words
        for words, kinds in _PARTS.items()
        if not any(known.get(kind) for kind in kinds) and (there[kinds[0]] or known.keys() & {*kinds})
    ]


def _names(topics: Iterable[str]) -> str:
    names = list(topics)
    return clean(", ".join(names[:8]) + (", ..." if len(names) > 8 else ""))


def _numbers(numbers: Sequence[int]) -> str:
    """Return positions in a log as human-readable text."""
    return ("message number " if len(numbers) == 1 else "messages number ") + _names(map(str, numbers))


def _proportion(what: ProportionRecord, kind: str = "fresh trial") -> tuple[str, str]:
    if not what.total:
        return f"no {kind} could tell", "not tested"
    return f"{what.count} of {plural(what.total, kind)}", f"95 %: {share_interval(what.low, what.high)}"


def _rule(view: FindingView) -> Iterator[Statement]:
    rule = view.rule
    if rule is None:
        return
    for line in rule.legend:
        yield Statement(clean(line), "by the definition of its type", "")
    yield Statement("failures that the rule predicts occur (precision)", *_proportion(rule.precision))
    yield Statement("failures that occur are predicted by the rule (recall)", *_proportion(rule.recall))
    if rule.in_context and rule.in_context.total:
        yield Statement("with nominal messages first, the rule is right", *_proportion(rule.in_context))
    if rule.in_campaign and rule.in_campaign.total:
        failed, held = rule.held  # what the share leaves out for a failure that occurs only sometimes
        trials = f"of {plural(held, 'trial')} in which it holds, {failed} failed: passing ones are left out"
        claim = f"in the campaign, the rule was right{f' ({trials})' if held else ''}"
        yield Statement(claim, *_proportion(rule.in_campaign, "earlier trial"))
    for one in rule.alternatives:
        evidence = "it explains all trials that the rule was learnt from, too"
        decided = f"would be decided by {_values(one.decided_by)}"
        yield Statement(f"the rule may as well be: {clean(one.text)}", evidence, decided)


def _values(values: Mapping[str, Value]) -> str:
    return clean(", ".join(f"{name} = {value}" for name, value in values.items()))


def _outside(view: FindingView) -> Iterator[Statement]:
    if (found := view.permeability) is not None:
        reaching, runs = [edge for edge in found.edges if edge.permeable], plural(found.runs, "run")
        evidence = f"{runs} of the whole system with random inputs"
        for edge in reaching[:_MOST]:
            claim = f"{clean(edge.external)} reaches {clean(edge.internal)}"
            explained = f"explains {share(edge.strength)} of the variance {edge.design}"
            sure = f"p = {number(edge.p_value)}; strength 95 %: {share_interval(edge.low, edge.high)}"
            yield Statement(claim, f"{evidence}; {explained}", sure)
        if found.edges and not reaching:
            claim = "no external field that was tested reaches a relevant one"
            yield Statement(claim, evidence, "absence of evidence: a weak or rare effect can be missed")
    if view.activation is not None:
        yield from _activation(view.activation, confirmed=view.activated)


def _activation(activation: ActivationRecord, *, confirmed: bool) -> Iterator[Statement]:
    failed, of_nominal = activation.controls_failed, plural(activation.controls, "run")
    if activation.found:
        replays = f"{activation.replays_failed} of {plural(activation.replays, 'replay')} failed again"
        if activation.controls:
            replays += f"; {failed} of {of_nominal} with nominal inputs failed so"
        if confirmed:
            low, high = exact_interval(activation.replays_failed, activation.replays)
            sure = f"95 %: {share_interval(low, high)} of replays fail"
            yield Statement("external inputs alone make the whole system fail", replays, sure)
        else:
            claim = "one run of the whole system failed with the external inputs that were found"
            yield Statement(claim, replays, "not confirmed by replays")
    elif activation.runs:
        searched = f"{plural(activation.runs, 'run')} of the whole system"
        if activation.chance:
            nominal = f"{failed} of {of_nominal} with nominal inputs failed so"
            searched += (
                f"; it failed at {plural(activation.chance, 'point')}, but not for certain more often: {nominal}"
            )
        claim = "no external inputs were found that make the whole system fail"
        yield Statement(claim, searched, "a search that ended, not a proof")
    for signature, count in activation.others.items():
        evidence = f"{count} of {plural(len(activation.points), 'run')} with other inputs"
        yield Statement(f"the whole system can also fail otherwise: {clean(signature)}", evidence, "not looked into")
    region = activation.region
    if region and region.inside and region.inside.total:
        seen = f"{region.inside.count} of {plural(region.inside.total, 'run')} inside failed"
        drawn = "it was drawn by these runs, so they do not test it"
        yield Statement("the whole system failed inside the crash region", seen, drawn)


def not_tried(view: FindingView, *, open_questions: Sequence[str] = ()) -> list[str]:
    """Return what a reader must not conclude from the page."""
    gaps = [clean(question, limit=600) for question in open_questions[:50]]
    gaps += [f"The step {step.name} has no result yet." for step, record in view.steps if record is None]
    gaps += [f"{name} cannot be used: {clean(reason)}" for name, reason in view.broken.items()]
    orders = view.fields is not None and any(order_of(name) for name in view.fields.considered)
    if view.fields and (unknown := _unknown_parts(view, view.fields, orders=orders)):
        gaps.append(f"Whether {' or '.join(unknown)} matter is not known.")
    if view.fields and view.fields.left:
        gaps.append(
            f"{plural(len(view.fields.left), 'field')} not varied, such as stamps, checksums and what riot.toml leaves "
            f"alone: {_names(view.fields.left)}"
        )
    if view.rule and not any(one and one.total for one in (view.rule.in_context, view.rule.in_campaign)):
        gaps.append("Whether the rule holds in longer logs than the minimal one was not asked.")
    if view.rule and view.rule.unjudged:
        unjudged = plural(view.rule.unjudged, "earlier trial")
        gaps.append(f"Whether the rule is right in {unjudged} is not known: messages lack fields of it.")
    if view.rule:
        about = "and the order of two messages, not about keys or" if orders else "not about keys, nor the order or"
        gaps.append(f"The rule is about values{' ' if orders else ', '}{about} timing of messages.")
    if view.permeability and view.permeability.pruned:
        gaps.append(
            f"{plural(len(view.permeability.pruned), 'external field')} not driven, for want of a path to the unit "
            "on the bus: " + ", ".join(clean(name, limit=80) for name in view.permeability.pruned[:12])
        )
    if view.permeability and view.permeability.untested:
        names = ", ".join(clean(name, limit=80) for name in list(view.permeability.untested)[:12])
        why = "; ".join(dict.fromkeys(clean(one, limit=200) for one in view.permeability.untested.values()))
        gaps.append(f"{plural(len(view.permeability.untested), 'external field')} not tested ({why}): {names}")
    for name, why in list(view.permeability.unseen.items())[:12] if view.permeability else ():
        gaps.append(f"What reaches {clean(name, limit=80)} from outside: {why}.")
    if (view.permeability and view.permeability.played) or (view.activation and view.activation.played):
        gaps.append(
            "How the outside answers: it was played from the nominal log, so what the system does had no effect on it."
        )
    if view.activation and not view.activation.runs:
        gaps.append(f"Runs of the whole system: {clean(view.activation.text, limit=400)}.")
    if view.activation and view.activation.region:
        axes = plural(len(view.activation.region.ranges), "external field")
        gaps.append(f"The crash region is drawn over {axes}: failures outside of it, or by others, may exist.")
    return gaps
