"""One self-contained page about one finding, for the maintainer who does not believe it yet."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from riot_bus.findings.backtrack import nodes_of
from riot_bus.findings.permeability import EdgeRecord
from riot_bus.findings.records import FieldRecord, FieldsRecord
from riot_bus.plugins import HOOKS
from riot_bus.report import format as words
from riot_bus.report.diagram import links
from riot_bus.report.finding_view import EVIDENCE, FindingView, Severity, evidence_files, load, tail_of
from riot_bus.report.formats import write_file
from riot_bus.report.plots import region_plots, rule_plot
from riot_bus.report.regression import regression_name
from riot_bus.report.statements import not_tried, other_fields, statements
from riot_bus.report.templating import rendered
from riot_bus.vocabulary.errors import needs_extra
from riot_bus.vocabulary.injection import PARAMETERS
from riot_bus.vocabulary.order import order_of

PAGE = "report.html"

_ROWS = 60  # about two screens of each list; the finding's JSON files have the rest
_PATHS = 200  # lines; a tree may have 10,000 hops, and permeability.json has them all
_SHARED = ("failure.mcap", "minimal.mcap", "activation.mcap", "activation-minimal.mcap", "reproduce.sh")
_PARAMETER = f"{PARAMETERS.removeprefix('#')}:"
_FORMS = ("rule.json", "sanitize.py", "sanitize.hpp")
_MEANING: dict[Severity, str] = {
    "unit only": "The unit fails on these inputs. Nothing shows yet that the system can produce them.",
    "permeable": "The outside world influences the inputs that the unit fails on. No confirmed run has made it fail.",
    "activated": "Inputs at the external interface alone make the whole system fail.",
    "whole system": "The whole system fails on these inputs from outside. Which of them it needs was not looked for.",
}


def write_report(directory: Path, *, open_questions: Sequence[str] = ()) -> Path:
    """Write `report.html` from the records that exist.

    Raises:
        ConfigError: `finding.json` is missing or unusable.
        MissingExtraError: jinja2 is not installed.
    """
    return write_file(HtmlReport(open_questions).render(load(directory)), directory / PAGE)


class HtmlReport:
    """The report format `html`: one page that needs no network."""

    file = PAGE

    def __init__(self, open_questions: Sequence[str] = ()) -> None:
        self._open_questions = open_questions

    def render(self, view: FindingView) -> str:
        """Return the page.

        Raises:
            MissingExtraError: jinja2 is not installed.
        """
        return rendered("report.html.j2", **_context(view, self._open_questions))


def _context(view: FindingView, open_questions: Sequence[str]) -> dict[str, Any]:
    with needs_extra("jinja2", "report"):
        from markupsafe import Markup

    plot = rule_plot(view.rule) if view.rule else None
    activation, nominal = view.activation, view.permeability.nominal if view.permeability else {}
    region = activation and activation.region
    maps = region_plots(activation.points, region, nominal=nominal) if activation and region else []
    points = activation.points if activation else ()
    met = [one for one in points if one.distance is not None and one.distance <= 0]
    return {
        "view": view,
        "finding": view.finding,
        "meaning": _MEANING[view.severity],
        "links": links(view),
        "rule_plot": plot and {"svg": Markup(plot.svg), "caption": plot.caption},  # noqa: S704 - serialised from a tree
        "maps": [{"svg": Markup(one.svg), "caption": one.caption} for one in maps],  # noqa: S704 - as above
        "messages": _messages(view),
        "no_field": _no_field(view.fields),
        "other_fields": other_fields(view.fields) if view.fields else None,
        "trees": _trees(view),
        "paths": _paths(view),
        "best_paths": [str(path) for path in view.permeability.paths] if view.permeability else [],
        "backtrack": _backtrack(view),
        "nominal": nominal,
        "parameters": activation is not None and any(name.startswith(_PARAMETER) for name in activation.found or ()),
        "met": sum(one.phase == "search" and not one.failed for one in met),
        "statements": statements(view),
        "gaps": not_tried(view, open_questions=open_questions),
        "rows": _ROWS,
        "files": [name for name in (*_SHARED, regression_name(view.finding)) if (view.directory / name).is_file()],
        "forms": [name for name in _FORMS if (view.directory / name).is_file()],
        "evidence": _evidence(view.directory),
    }


def _backtrack(view: FindingView) -> list[str]:
    """Return the paths in logs alone as lines, which the extension that finds them writes."""
    there = view.backtrack is not None and "backtrack_lines" in HOOKS.targets()
    return list(HOOKS.load("backtrack_lines")(view.backtrack)) if there else []


def _evidence(directory: Path) -> list[tuple[str, str]]:
    """Return the name of each file that a failing trial has left, with the end of its text if it is a `.txt`."""
    paths = evidence_files(directory)[:_ROWS]
    return [(f"{EVIDENCE}/{one.name}", tail_of(one, 6000) if one.suffix == ".txt" else "") for one in paths]


def _messages(view: FindingView) -> list[tuple[str, list[FieldRecord]]]:
    """Return the minimal messages, as fields name them, with their relevant fields and orders."""
    topics = view.minimal.topics if view.minimal else ()
    fields = view.fields.fields if view.fields else ()
    found = []
    for place, topic in enumerate(topics[:_ROWS]):
        name = f"{topic}[{topics[:place].count(topic)}]" if topics.count(topic) > 1 else topic
        found.append((name, [one for one in fields if one.name.startswith(f"{name}:") or _orders(one.name, topic)]))
    return found


def _orders(name: str, topic: str) -> bool:
    order = order_of(name)
    return order is not None and topic in (order.first, order.second)


def _no_field(fields: FieldsRecord | None) -> str:
    """Return what is known of a message without a relevant field."""
    if fields is None:
        return "not searched yet"
    sure = fields.complete and fields.straight and not fields.unconfirmed and not fields.structure
    return "none: that it arrives is enough" if sure else "none confirmed"


def _follows(node: dict[str, Any]) -> str:
    """Return which field of a topic on a path follows which external field; empty where that was not tested."""
    edge = node.get("follows")
    if not isinstance(edge, dict):
        return ""
    if not edge.get("permeable"):
        return f": no effect found in {edge.get('internal')}"
    return f": {edge.get('internal')} follows {edge.get('external')} (share {edge.get('strength', 0):.2g})"


def _trees(view: FindingView) -> list[dict[str, Any]]:
    """Return per internal field the external ones that reach it, and those that do not."""
    grouped: dict[str, list[EdgeRecord]] = {}
    for edge in view.permeability.edges if view.permeability else ():
        grouped.setdefault(edge.internal, []).append(edge)
    return [
        {
            "root": internal,
            "leaves": sorted((one for one in found if one.permeable), key=lambda one: -one.strength)[:_ROWS],
            "others": [one for one in found if not one.permeable],
        }
        for internal, found in sorted(grouped.items())[:_ROWS]
    ]


def _paths(view: FindingView) -> list[str]:
    """Return the paths on the bus from the unit's topics outwards, as indented lines."""
    lines: list[str] = []
    for node, _, depth in islice(nodes_of(view.permeability.tree if view.permeability else []), _PATHS):
        marks = [word for word in ("external", "loop", "cut") if node.get(word)]
        via = f" by {node['component']}" if node.get("component") else ""
        told = f"{node.get('topic', '?')}{via}{' (' + ', '.join(marks) + ')' if marks else ''}{_follows(node)}"
        lines.append("   " * min(depth, 20) + ("└─ " if depth else "") + words.clean(told))
    return lines
