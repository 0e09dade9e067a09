"""A router's status as plain data and as tables; names that come from the network are only quoted."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

from riot_bus.pipeline.runner import OTHER_TOPICS
from riot_bus.router.counts import TopicCounts
from riot_bus.vocabulary.redaction import redacted
from riot_bus.vocabulary.text_table import table_lines
from riot_bus.zenoh.session_config import is_control

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from riot_bus.control.reach import Bypass
    from riot_bus.graph.model import Graph
    from riot_bus.inject.injection_plan import InjectionPlan
    from riot_bus.pipeline.runner import Pipeline
    from riot_bus.pipeline.stage import Stage
    from riot_bus.router.bus import Bus
    from riot_bus.router.counts import Losses
    from riot_bus.zenoh.segments import Segment

MOST_TOPICS = 2000
"""Number of topics that are listed one by one, the busiest; the rest are summed up in one row."""


def shown_endpoints(segment: Segment) -> tuple[str, ...]:
    """Return the endpoints that a segment listens on, without the part after `#`."""
    return tuple(redacted(each) for each in segment.endpoints)


def segment_rows(bus: Bus, graph: Graph) -> dict[str, dict[str, Any]]:
    """Return endpoints and connected components of each segment; names as far as the graph knows them."""
    ours = bus.ids | bus.ids_ever
    rows = {}
    for name, session in bus.sessions.items():
        found = {str(each.zid): str(each.whatami) for each in session.info.transports()}
        components = []
        for zid in sorted(zid for zid in found.keys() - ours if not is_control(zid)):
            known = graph.component(zid, name)
            label = known.label if known is not None and known.label != zid[:8] else ""
            components.append({"zid": zid, "mode": found[zid], "name": label})
        rows[name] = {"endpoints": list(shown_endpoints(bus.segment(name))), "components": components}
    return rows


def interceptor_rows(pipeline: Pipeline) -> list[dict[str, Any]]:
    """Return each interceptor with its conditions, why it is bypassed if it is, and its errors."""
    return [_interceptor(stage, pipeline) for stage in pipeline.stages]


def _interceptor(stage: Stage, pipeline: Pipeline) -> dict[str, Any]:
    when = type(stage.when)()
    conditions = {
        each.name: getattr(stage.when, each.name)
        for each in fields(stage.when)
        if getattr(stage.when, each.name) != getattr(when, each.name)
    }
    errors = pipeline.errors.get(stage.name)
    return {
        "name": stage.name,
        "topics": None if stage.expressions is None else list(stage.expressions),
        "conditions": conditions,
        "bypassed": stage.bypassed,
        "errors": errors.count if errors is not None else 0,
        "place": errors.place if errors is not None else "",
        "error": _last_error(errors.first) if errors is not None else "",
    }


def _last_error(trace: str) -> str:
    """Return the end of a traceback: the exception, and the indented lines of its text, such as hints."""
    found: list[str] = []
    for line in reversed(trace.strip().splitlines()):
        found.append(line.strip())
        if not line.startswith(" "):
            break
    return " ".join(reversed(found))


def plan_row(plan: InjectionPlan | None) -> dict[str, Any] | None:
    """Return a plan's name and how often it was carried out; None if there is none."""
    if plan is None:
        return None
    injector = plan.injector
    hits = [injector.hits[number] for number in range(len(injector.injections))]
    return {
        "name": plan.name,
        "injections": len(hits),
        "hits": sum(hits),
        "hits_by_injection": hits,
        "skipped": sum(injector.skipped.copy().values()),
        "problems": {topic: error.message for topic, error in list(injector.problems.items())[:20]},
    }


def count_rows(counts: Mapping[str, TopicCounts], *, most: int = MOST_TOPICS) -> dict[str, dict[str, Any]]:
    """Return counts by topic, and whether they balance: received + added == forwarded + dropped + lost + held."""
    busiest = sorted(counts, key=lambda topic: counts[topic].received + counts[topic].recorded, reverse=True)
    shown = {topic: counts[topic] for topic in sorted(busiest[:most])}
    if busiest[most:]:
        rest = [counts[topic] for topic in busiest[most:]] + ([shown[OTHER_TOPICS]] if OTHER_TOPICS in shown else [])
        shown[OTHER_TOPICS] = _sum(rest)
    return {topic: {**asdict(each), "balanced": _balanced(each)} for topic, each in shown.items()}


def _sum(counts: Iterable[TopicCounts]) -> TopicCounts:
    total = TopicCounts()
    for each in counts:
        for field in fields(TopicCounts):
            setattr(total, field.name, getattr(total, field.name) + getattr(each, field.name))
    return total


def _balanced(each: TopicCounts) -> bool:
    return each.received + each.added == each.forwarded + each.dropped + each.lost + each.held


def loss_rows(losses: Losses) -> dict[str, Any]:
    """Return what was lost, why, and which links broke."""
    return {
        "messages": sum(losses.messages.values()),
        "recordings": sum(losses.recordings.values()),
        "reasons": dict(losses.reasons),
        "links": [asdict(each) for each in losses.links],
    }


def bypass_rows(bypasses: Iterable[Bypass]) -> list[dict[str, Any]]:
    """Return each way around the router, and its cure."""
    return [
        {
            "kind": each.kind,
            "active": each.active,
            "components": [{"segment": one.segment, "zid": one.zid, "name": one.label} for one in each.components],
            "evidence": each.evidence,
            "cure": each.cure,
        }
        for each in bypasses
    ]


def count_table(counts: Mapping[str, Any]) -> list[str]:
    """Return the lines of a table: one row per topic.

    Args:
        counts: Counts by topic, as `TopicCounts` or as the rows from `count_rows`.
    """
    names = [each.name for each in fields(TopicCounts)]
    rows = [["topic", *names]]
    for topic, each in counts.items():
        row = each if isinstance(each, dict) else asdict(each)
        rows.append([topic, *(str(row[name]) for name in names)])
    return table_lines(rows)
