"""The chain as a diagram: the text and the state of each box; the template draws it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from riot_bus.report.finding_view import FindingView
from riot_bus.report.format import clean, plural, seconds

State = Literal["done", "next", "open"]


@dataclass(frozen=True, slots=True)
class DiagramBox:
    """One box of the chain."""

    title: str
    lines: tuple[str, str]
    effort: str
    state: State


def links(view: FindingView) -> list[DiagramBox]:
    """Return the boxes from the nominal log to the activation."""
    finding = view.finding
    done: dict[str, tuple[str, str]] = {"test": (plural(finding.messages, "message"), f"{finding.modified} modified")}
    if view.minimal:
        what, proven = ("needed", "") if view.minimal.one_minimal else ("kept", ", not proven")
        kept = plural(len(view.minimal.kept), "message")
        done["minimize"] = (_short(f"{kept} {what}"), _short(f"of {view.minimal.before}{proven}"))
    if view.fields:
        names = [one.name for one in view.fields.fields]
        done["relevance"] = (f"{len(names)} of {len(view.fields.considered)}", _short(", ".join(map(_leaf, names))))
    if view.rule:
        text = clean(view.rule.text, limit=400)
        for name in view.rule.scale:
            text = text.replace(name, _leaf(name))
        done["rules"] = (_short(text), f"{plural(len(view.rule.samples), 'sample')}")
    if view.permeability:
        reaching = view.permeability.permeable
        tested = {edge.external for edge in view.permeability.edges}
        done["permeability"] = (f"{len(reaching)} of {len(tested)} reach it", _short(", ".join(map(_leaf, reaching))))
    if view.activation:
        again = f"{view.activation.replays_failed} of {plural(view.activation.replays, 'replay')}"
        runs = plural(view.activation.runs, "system run")
        missed = "not reached" if view.activation.runs else "not tested"
        done["activate"] = (again if view.activation.found else missed, runs)
    done |= {step.name: (_short(clean(record.summary)), "") for step, record in view.further}
    into = "from outside" if finding.whole_system else _short(f"into {clean(finding.unit)}")
    start = DiagramBox("nominal log", (_short(f"of {clean(finding.system)}"), into), "", "done")
    return [start] + [
        DiagramBox(
            clean(step.title),
            done.get(step.name, (f"riot {step.name}", "")),
            f"{plural(record.trials, 'trial')}, {seconds(record.seconds)}" if record else "",
            "done" if record else "next" if view.next_step == step.name else "open",
        )
        for step, record in view.steps
    ]


def _leaf(name: str) -> str:
    return clean(name.rpartition(":")[2] or name)


def _short(text: str) -> str:
    # a box has room for 118 px; letters of size 12 take about 6
    return text if len(text) <= 19 else text[:18] + "…"
