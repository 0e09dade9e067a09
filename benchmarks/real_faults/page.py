"""Tables of results, and the page docs/real-software.md that is made of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.real_faults.case import Case
from benchmarks.real_faults.grade import GOOD
from riot_bus.vocabulary.counting import counted

SORTS = ("known", "other", "own", "false")
PAGE = Path(__file__).resolve().parents[2] / "docs/real-software.md"
_HEAD = """# What riot finds in software of others

Each row is a public report about a release that nobody here wrote, in a thin node of ours, with a truth that says for
which inputs the fault occurs; riot has not seen it. `riot test`, then `riot analyze`, with defaults; the truth grades
what they say. How a case is made, and added in an hour: `benchmarks/real_faults/README.md`. This page is made by
`python -m benchmarks.real_faults page`, misses and all.
"""
_LEGEND = f"""
- met: the fault is among the findings. rule: balanced accuracy of the best rule on 5,000 inputs near the limits of the
  truth and far away (at least {GOOD} counts as explained), and the rule.
- findings: the known fault, other faults that the program shows without riot, payloads of another form that the node
  does not check, and false ones.
- wrong: what riot said and the truth contradicts. twin: findings on the mended release, or on a node that checks.
"""

_FOUND = (
    ("MAVProxy 1.8.75 (`tests/e2e/test_mavlink.py`)", "`BATTERY_STATUS.id` = 101", "`KeyError`, caught and printed"),
    ("", "`MAG_CAL_REPORT.compass_id` = 7", "`IndexError`, likewise"),
    ("", "`RPM.rpm1` infinite", "`OverflowError`, likewise"),
    ("dronekit 2.9.2", "`HEARTBEAT.custom_mode` = 99 of a copter", "the mode is not taken over"),
    ("", "`STATUSTEXT.severity` = 8", "the text is lost"),
    ("pathfinding 1.0.23, `IDAStarFinder`", "a goal that walls enclose", "never ends"),
    ("", "start = end", "`IndexError`"),
    ("filterpy 2.0.0, `KalmanFilter`", "NaN, or an infinite variance, once", "state and covariance stay NaN"),
    ("filterpy 2.0.0, `UnscentedKalmanFilter`", "`dt` = 1e10, or a position of 1e300, once", "`predict` always raises"),
)
"""Faults that earlier campaigns have come upon: program, input, what happens."""


def table(results: Sequence[Mapping[str, Any]]) -> str:
    """Return riot's grades in Markdown."""
    heads = ("case", "kind", "met", "rule", "findings", "tried", "wrong", "twin", "trials", "test s", "all s")
    return _markdown(heads, [_row(one) for one in results])


def _row(one: Mapping[str, Any]) -> list[str]:
    grade, seconds = one["grade"], [f"{one['test_s']:.0f}", f"{one['seconds']:.0f}"]
    if grade is None:
        return [one["name"], one["kind"], "error", one["error"], "", "", "", "", "", *seconds]
    rules = [each for each in grade["findings"] if each["accuracy"] is not None]
    best = max(rules, key=lambda each: each["accuracy"], default=None)
    wrong = [*grade["wrong"], *(text for each in grade["findings"] for text in each["wrong"])]
    return [
        one["name"],
        one["kind"],
        {True: "yes", False: "**no**", None: ""}[grade["met"] if one["kind"] != "control" else None],
        "" if best is None else f"{best['accuracy']:.2f} `{best['rule']}`",
        _sorts(Counter(each["sort"] for each in grade["findings"])),
        f"{grade['tried']} of {grade['coverable']}",
        "; ".join(wrong),
        _sorts(one["twin"]),
        str(grade["trials"]),
        *seconds,
    ]


def peers_table(results: Sequence[Mapping[str, Any]]) -> str:
    """Return what riot and its peers met in the same time, after how many logs and seconds, in Markdown."""
    with_peers = [one for one in results if one["peers"]]
    names = list(with_peers[0]["peers"]) if with_peers else []
    rows = []
    for one in with_peers:
        cells = [one["name"], "yes" if one["grade"] and one["grade"]["met"] else "**no**"]
        for peer in one["peers"].values():
            logs = counted(peer["runs"], "log")
            cells.append(f"{logs}, {peer['seconds']:.1f} s" if peer["met"] else f"**no** ({logs})")
        rows.append(cells)
    return _markdown(("case", "riot", *names), rows)


def summary(results: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield what the results come to, where a peer beats riot first."""
    graded = [one for one in results if one["grade"]]
    faults, controls = ([one for one in graded if (one["kind"] == "control") is each] for each in (False, True))
    beaten = [
        f"{one['name']} ({', '.join(name for name, peer in one['peers'].items() if peer['met'])})"
        for one in faults
        if not one["grade"]["met"] and any(peer["met"] for peer in one["peers"].values())
    ]
    if beaten:
        yield f"Peers met what riot missed in the same time: {'; '.join(beaten)}."
    met = sum(one["grade"]["met"] for one in faults)
    good = sum(any((each["accuracy"] or 0) >= GOOD for each in one["grade"]["findings"]) for one in faults)
    wrong = sum(len(one["grade"]["wrong"]) + sum(len(x["wrong"]) for x in one["grade"]["findings"]) for one in faults)
    false = sum(each["sort"] == "false" for one in graded for each in one["grade"]["findings"])
    yield f"riot met {met} of {len(faults)} faults and explained {good}."
    yield f"{wrong} claims were wrong, {false} findings false."
    if controls:
        clean = sum(not {each["sort"] for each in one["grade"]["findings"]} - {"own"} for one in controls)
        yield f"Of {len(controls)} controls, {clean} had no finding but payloads of another form."
    loads = [one["load"] for one in results]
    yield f"Load of the machine: {min(loads, default=0):.1f} to {max(loads, default=0):.1f}."


def page(saved: Mapping[str, Any], cases: Sequence[Case]) -> str:
    """Return the page made of saved results."""
    results, about = saved["results"], saved["about"]
    reports = {case.name: case.file for case in cases}
    faults, controls = ([one for one in results if (one["kind"] == "control") is each] for each in (False, True))
    listed = [
        [one["name"], reports[one["name"]].report, ", ".join(reports[one["name"]].packages), reports[one["name"]].title]
        for one in faults
        if one["name"] in reports
    ]
    parts = [
        " ".join(summary(results)),
        f"{about['date']}, commit {about['commit']}, {about['cpus']} processors, Python {about['python']}, "
        f"{about['seconds']:g} s for `riot analyze`, seed {about['seed']}."
        + (f" Peers: {about['peers']}." if "peers" in about else ""),
        _HEAD.partition("\n\n")[2].strip(),
        "## Faults",
        table(faults),
        _LEGEND.strip(),
        "## Beside what people would use",
        peers_table(faults),
        "## Controls",
        table(controls),
        "## The reports",
        _markdown(("case", "report", "packages", "fault"), listed),
        "## Found, not reported",
        "Earlier campaigns came upon these; each was seen without riot, too. No report was found, so none is a case.",
        _markdown(("program", "input", "what happens"), _FOUND),
    ]
    return "\n\n".join([_HEAD.partition("\n")[0], *parts]) + "\n"


def _sorts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{counts[name]} {name}" for name in SORTS if counts.get(name)) or "none"


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)
