"""The paths from a field back to external fields, as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from riot_bus.findings.backtrack import BacktrackRecord, EvidenceRecord, StepRecord, nodes_of
from riot_bus.report.format import clean, seconds, share, share_interval
from riot_bus.vocabulary.counting import counted

_FOUND = 3  # pairs of fields, one in a line of the tree; the others are counted
_REASONS = 3  # all stand in one line, the most frequent first
_NAMES = 8  # each may have 200 characters, all in one line; backchain.json has the rest


def lines(record: BacktrackRecord) -> Iterator[str]:
    """Yield the record as human-readable lines."""
    looked_at = counted(record.looked_at, "message", mark=",")
    of = f" of {record.messages:,}" if record.looked_at != record.messages else ""
    yield f"{', '.join(map(clean, record.targets))}: {looked_at}{of} in {counted(len(record.logs), 'log')}"
    yield f"source of readers and writers of topics: {clean(', '.join(record.told)) or 'none, so they are inferred'}"
    for name, reason in record.targets.items():
        if reason:
            yield f"{clean(name)} cannot be tested: {clean(reason)}"
    steps = {(step.source, step.target): step for step in record.steps}
    for tree in record.trees:
        yield ""
        yield from _tree(tree, record, steps)
    yield ""
    yield from _ranking(record)
    yield ""
    yield from _notes(record)


def _tree(tree: dict[str, Any], record: BacktrackRecord, steps: dict[tuple[str, str], StepRecord]) -> Iterator[str]:
    for node, parent, depth in nodes_of([tree]):
        topic = node["topic"]
        indent = "   " * (depth - 1) + "└─ " if depth else ""
        step = steps.get((topic, parent))
        by = f" by {clean(node['component'])}" if node["component"] else ""
        marks = _marks(node, record, step)
        yield f"{indent}{clean(topic)}{by}{f' [{marks}]' if marks else ''}"
        if step is not None:
            yield from (f"{'   ' * depth}   {text}" for text in said_of(step, record))
        alone = steps.get(("", topic))
        if alone is not None and not node["again"]:
            yield from (f"{'   ' * depth}   of all other topics: {text}" for text in said_of(alone, record))


def _marks(node: dict[str, Any], record: BacktrackRecord, step: StepRecord | None) -> str:
    topic = node["topic"]
    marks = []
    if topic in record.externals:
        who = record.externals[topic]
        told = who in ("riot.toml", "--external")
        marks.append("external" if told else f"taken as external: {clean(who)}")
    elif topic in record.unwritten:
        marks.append("unknown writer")
    if topic in record.missing:
        marks.append("not recorded")
    if step is not None and step.inferred:
        marks.append("inferred")
    marks += [word for word in ("loop", "cut") if node[word]]
    if node["again"]:
        marks.append("followed elsewhere")
    return ", ".join(marks)


def said_of(step: StepRecord, record: BacktrackRecord) -> list[str]:
    """Return the evidence in the logs for a step back, in one sentence or a few."""
    found = [one for one in step.evidence if one.found]
    if found:
        rest = [f"and {counted(len(found) - _FOUND, 'further pair')} of fields"] if len(found) > _FOUND else []
        return [_follows(one) for one in found[:_FOUND]] + rest
    tested = [one for one in step.evidence if one.verdict == "no evidence"]
    if tested:
        return [f"no evidence in these logs ({_basis(tested)})"]
    if step.source in record.missing or step.target in record.missing:
        return ["not tested: not recorded"]
    if step.evidence:
        return [f"not tested: {_reasons(step.evidence)}"]
    return ["not tested: no numeric field that could tell"]


def _follows(one: EvidenceRecord) -> str:
    source, target = clean(_path(one.source)), clean(_path(one.target))
    what = f"how much {target} varies goes with {source}" if one.follows == "spread" else f"{target} follows {source}"
    return f"{what}: {_strength(one)}"


def _strength(one: EvidenceRecord) -> str:
    size = ""
    if one.strength is not None and one.low is not None and one.high is not None:
        size = f"{share(one.strength)} ({share_interval(one.low, one.high)}), "
    lag = ""
    if one.lag_s is not None:
        lag = f"after {seconds(one.lag_s) if one.lag_s >= 1 else f'{one.lag_s * 1000:.0f} ms'}, "
    return f"{size}{lag}p = {one.p_value:.2g}, {_rests([one])}"


def _basis(tested: Sequence[EvidenceRecord]) -> str:
    shown = [one.detectable for one in tested if one.detectable is not None]
    bound = f"; an effect of {share(max(shown))} or more would have shown about half of the time" if shown else ""
    if few := len(tested) - len(shown):
        bound += f"{f', but {few} of them had' if shown else ';'} too few messages to show any effect"
    return f"{counted(len(tested), 'pair')} of fields, {_rests(tested)}{bound}"


def _rests(some: Sequence[EvidenceRecord]) -> str:
    fewest = min(some, key=lambda one: one.messages)
    least = "at least " if len({one.messages for one in some}) > 1 else ""
    return f"{least}{counted(fewest.messages, 'message', mark=',')} of {counted(fewest.logs, 'log')}"


def _reasons(some: Sequence[EvidenceRecord]) -> str:
    count = Counter(one.reason for one in some)
    told = [f"{clean(reason)} ({counted(number, 'pair')})" for reason, number in count.most_common(_REASONS)]
    return "; ".join(told) + ("; ..." if len(count) > _REASONS else "")


def _ranking(record: BacktrackRecord) -> Iterator[str]:
    found = [one for one in record.ranking if one.found]
    silent = [one for one in record.ranking if one.verdict == "no evidence"]
    untested = [one for one in record.ranking if one.verdict == "not tested"]
    if not record.externals:
        yield "no external topic is known: name some with --external, or in riot.toml"
        return
    yield f"external fields, the most promising first ({counted(len(record.ranking), 'pair')} of fields):"
    for place, one in enumerate(found, start=1):
        arrow = f" -> {clean(one.target)}" if len(record.targets) > 1 else ""
        what = ", the spread of the target follows it" if one.follows == "spread" else ""
        yield f"  {place}. {clean(one.source)}{arrow}{what}: {_strength(one)}"
    if not found:
        shows = "shows in these logs, which does not mean that none has an effect" if silent else "could be tested"
        yield f"  none of them {shows}"
    if silent:
        names = ", ".join(clean(one.source) for one in silent[:_NAMES])
        more = f" and {len(silent) - _NAMES} more" if len(silent) > _NAMES else ""
        yield f"  no evidence: {names}{more} ({_basis(silent)})"
    if untested:
        yield f"  not tested: {_reasons(untested)}"
    if record.unreachable:
        yield f"  no way leads from: {', '.join(map(clean, record.unreachable))}"


def _notes(record: BacktrackRecord) -> Iterator[str]:
    for loop in record.loops:
        yield f"loop: {', '.join(map(clean, loop))}"
    for topic in record.unwritten:
        yield f"no component is known to write {clean(topic)}"
    for topic in record.missing:
        yield f"not recorded: {clean(topic)}"
    if record.unseen:
        names = ", ".join(map(clean, record.unseen[:_NAMES]))
        yield f"not looked at, as there were too many: {names}{' ...' if len(record.unseen) > _NAMES else ''}"
    for note in record.notes:
        yield clean(note, limit=400)
    yield (
        f"{counted(record.tested, 'pair')} of fields tested; for each field, the chance that any other is named by "
        f"accident is at most {share(record.alpha)}"
    )
    yield "shares are of what a field's own past does not explain; 95 % intervals are over logs or stretches of them"
    yield (
        "nothing was perturbed, so a common cause of two fields that is not in these logs may be the reason"
        "; `riot permeability` tests that"
    )


def _path(name: str) -> str:
    return name.rpartition(":")[2]
