"""What every report format has to hold, as tests to inherit: for authors of formats for `riot report --format`.

    class TestMine(ReportConformance):
        report = MyReport

Needs pytest: pip install 'riot-bus[testing]'.
"""

from __future__ import annotations

import copy
import json
import unicodedata
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import pytest

from riot_bus.findings.steps import STEPS
from riot_bus.report.finding_view import load

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.report.finding_view import FindingView
    from riot_bus.report.formats import ReportFormat

__all__ = ["FINDING_FILES", "HOSTILE_TEXT", "STAGES", "ReportConformance", "view_at"]

_X, _GOAL, _SPEED = "/map:x", "/goal:pose.x", "/odom:speed"
_RATE = {"value": 0.98, "low": 0.93, "high": 1.0, "count": 98, "total": 100}
_CERTIFICATE = {
    "failing": -1,
    "passing": 52,
    "others": {"/map:y": 117},
    "failing_log": "trials/fails.mcap",
    "passing_log": "trials/passes.mcap",
    "confirmed_failing": 5,
    "confirmed_passing": 5,
    "repeats": 5,
}
_EDGE = {"internal": _X, "permeable": True, "strength": 0.6, "low": 0.5, "high": 0.7, "lag_s": 0.4, "p_value": 0.01}
_POINTS = [{"values": {_GOAL: x, _SPEED: y}, "distance": x - y, "failed": x < y} for x in range(9) for y in range(9)]

FINDING_FILES: dict[str, Any] = {
    "finding.json": {
        "id": "planner-crash-1f3a",
        "system": "rover",
        "system_file": "rover/riot.toml",
        "unit": "planner",
        "component": "planner",
        "monitor": "crash",
        "signature": "IndexError in costmap.py:update",
        "details": ["Traceback (most recent call last):", "IndexError: index -4"],
        "injections": [{"topic": "/map", "field": "x", "value": -1}],
        "messages": 5012,
        "modified": 38,
        "trials": 212,
        "seconds": 341.0,
    },
    "minimal.json": {"before": 5012, "kept": [3391], "topics": ["/map"], "one_minimal": True},
    "fields.json": {
        "fields": [{"name": _X, "kind": "exceptional", "type": "int32", "failing": -1, "certificate": _CERTIFICATE}],
        "considered": [_X, "/map:y"],
        "bound": 0.03,
        "straight": 95,
    },
    "rule.json": {
        "text": f"{_X} < 0",
        "rule": {},
        "python": "def rule(v):\n    return v['/map:x'] < 0\n",
        "precision": _RATE,
        "recall": _RATE,
        "balanced_accuracy": 0.99,
        "scale": {_X: 40.0},
        "samples": [{"values": {_X: x}, "failed": x < 0} for x in range(-20, 20)],
    },
    "permeability.json": {
        "edges": [{**_EDGE, "external": _GOAL}, {**_EDGE, "external": "/imu:z", "permeable": False}],
        "runs": 12,
        "pruned": ["/battery:voltage"],
        "nominal": {_GOAL: [0.0, 60.0], _SPEED: [1.0, 2.0]},
        "tree": [{"topic": "/map", "component": None, "hops": [{"topic": "/goal", "external": True, "hops": []}]}],
    },
    "activation.json": {
        "found": {_GOAL: 1.0, _SPEED: 3.0},
        "runs": 81,
        "best_distance": -1.2,
        "replays": 10,
        "replays_failed": 10,
        "region": {
            "ranges": [{"field": _GOAL, "low": 0, "high": 4}, {"field": _SPEED, "low": 5, "high": 9, "ends": ["high"]}],
            "inside": _RATE,
        },
        "points": _POINTS,
        "messages": 2,
    },
}
"""A whole finding: the JSON files as docs/findings.md describes them, in the order of the steps."""

HOSTILE_TEXT = "</code></style><script>alert(1)</script>\"'><b onclick=alert(2)>\n{{ 7*7 }}\x1b[2J\r\u202e\x00$|`*_#"
"""What anybody on the network may call a node, a topic or an error."""

_STEP_OF = {step.kind.FILE: step.name for step in STEPS}
_KEPT_KEYS = {"kind", "ends"}  # their values are some of a few words
_FREE_KEYS = {"values", "others", "found", "nominal", "scale", "injections"}  # their keys are names


def _poisoned(what: Any, key: str = "") -> Any:
    if isinstance(what, dict):
        names = {name: f"{name}{HOSTILE_TEXT}" if key in _FREE_KEYS else name for name in what}
        return {names[name]: _poisoned(value, name) for name, value in what.items()}
    if isinstance(what, list):
        return [_poisoned(each, key) for each in what]
    return f"{what}{HOSTILE_TEXT}" if isinstance(what, str) and key not in _KEPT_KEYS else what


def _stages() -> dict[str, dict[str, Any]]:
    """Return the files of a finding by stage of progress; text stands for a file that is no JSON."""
    names = list(FINDING_FILES)
    found = {f"until {_STEP_OF[name]}": dict(list(FINDING_FILES.items())[: at + 1]) for at, name in enumerate(names)}
    for name in names[1:]:
        found[f"without {_STEP_OF[name]}"] = {other: FINDING_FILES[other] for other in names if other != name}
        found[f"broken {_STEP_OF[name]}"] = FINDING_FILES | {name: "{"}
    found["nothing permeable"] = found["until permeability"] | {
        "permeability.json": FINDING_FILES["permeability.json"] | {"edges": [], "nominal": {}, "tree": []}
    }
    activation = FINDING_FILES["activation.json"]
    changed: dict[str, dict[str, Any]] = {
        "not confirmed": {"replays_failed": 0},
        "not activated": {"found": None, "region": None, "replays": 0, "replays_failed": 0, "best_distance": None},
        "not measured": {"best_distance": float("nan"), "points": [{**_POINTS[0], "distance": float("inf")}]},
    }
    for stage, changes in changed.items():
        found[stage] = FINDING_FILES | {"activation.json": activation | changes}
    found["hostile"] = {name: _poisoned(copy.deepcopy(record)) for name, record in FINDING_FILES.items()}
    return found


STAGES = _stages()
"""Files of findings by stage of progress, some broken, one with hostile names."""


def view_at(stage: str, folder: Path) -> FindingView:
    """Write the files of a stage into a folder and read them.

    Args:
        stage: One of `STAGES`.
        folder: An empty folder.
    """
    for name, record in STAGES[stage].items():
        (folder / name).write_text(record if isinstance(record, str) else json.dumps(record), encoding="utf-8")
    return load(folder)


class ReportConformance:
    """What holds for a report format: it reports any stage of progress, and nobody's names do anything in it.

    Attributes:
        report: The class, or what else makes the format.
        markup: Whether the report is HTML or XML, where names must not become tags.
        binary: Whether it is no text.
    """

    report: ClassVar[Callable[[], ReportFormat]]
    markup: ClassVar[bool] = False
    binary: ClassVar[bool] = False

    def test_its_file_is_a_name_of_its_own(self) -> None:
        """It is written into the finding's folder, over none of the finding's files, or to stdout."""
        file = type(self).report().file
        assert Path(file).name == file
        assert file not in _STEP_OF

    @pytest.mark.parametrize("stage", STAGES)
    def test_every_stage_is_reported(self, stage: str, tmp_path: Path) -> None:
        """Nothing is raised whichever files are missing or broken, something is said, and nothing is written."""
        view = view_at(stage, tmp_path)
        before = {path: path.read_bytes() for path in tmp_path.iterdir()}
        content = type(self).report().render(view)
        assert content
        assert isinstance(content, bytes) if self.binary else self._text(content)
        assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before

    def test_it_is_deterministic(self, tmp_path: Path) -> None:
        """The same files give the same report, whoever makes it."""
        view = view_at("until activate", tmp_path)
        assert type(self).report().render(view) == type(self).report().render(load(tmp_path))

    def test_hostile_names_stay_text(self, tmp_path: Path) -> None:
        """They neither move a terminal's cursor nor reorder a line nor become tags or attributes."""
        folders = [tmp_path / name for name in ("hostile", "harmless")]
        for folder in folders:
            folder.mkdir()
        content = type(self).report().render(view_at("hostile", folders[0]))
        if self.binary:
            pytest.skip("this format is no text")
        text = self._text(content)
        kinds = {unicodedata.category(character) for character in text if character not in "\n\t"}
        assert not kinds & {"Cc", "Cf", "Cs", "Zl", "Zp"}
        if self.markup:
            harmless = self._text(type(self).report().render(view_at("until activate", folders[1])))
            assert _Markup(text).found <= _Markup(harmless).found

    @staticmethod
    def _text(content: str | bytes) -> str:
        """Return a report as text; what is not UTF-8 is an error."""
        return content.encode().decode() if isinstance(content, str) else content.decode()


class _Markup(HTMLParser):
    """The tags and attributes of a page."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.found: set[tuple[str, ...]] = set()
        self.feed(source)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found |= {(tag,), *((tag, name) for name, _ in attrs)}
