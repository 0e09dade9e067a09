"""Conformance tests for formats of `riot report --format`, for their authors to inherit.

    class TestMine(ReportConformance):  # CampaignReportConformance, if it has `render_campaign`
        report = MyReport

Needs pytest: the extra `testing`.
"""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, ClassVar

import pytest

from riot_bus.findings.steps import STEPS
from riot_bus.report.campaign_view import CampaignView, load_campaign
from riot_bus.report.finding_view import FindingView, load
from riot_bus.report.formats import CampaignFormat, ReportFormat, render

_X, _GOAL, _SPEED = "/map:x", "/goal:pose.x", "/odom:speed"
# made up, as all values of this finding; its interval contains its value
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
"""A complete finding: the JSON files described in docs/findings.md, in the order of the steps."""

HOSTILE_TEXT = "</code></style><script>alert(1)</script>\"'><b onclick=alert(2)>\n{{ 7*7 }}\x1b[2J\r\u202e\x00$|`*_#"
"""Hostile text that anyone on the network may use as the name of a node, a topic or an error."""

_STEP_OF = {step.kind.FILE: step.name for step in STEPS}
_KEPT_KEYS = {"kind", "ends"}  # keys with a fixed set of values
_FREE_KEYS = {"values", "others", "found", "nominal", "scale", "injections"}  # keys of objects whose own keys are names


def _poisoned(what: Any, key: str = "") -> Any:
    if isinstance(what, dict):
        names = {name: f"{name}{HOSTILE_TEXT}" if key in _FREE_KEYS else name for name in what}
        return {names[name]: _poisoned(value, name) for name, value in what.items()}
    if isinstance(what, list):
        return [_poisoned(each, key) for each in what]
    return f"{what}{HOSTILE_TEXT}" if isinstance(what, str) and key not in _KEPT_KEYS else what


def _stages() -> dict[str, dict[str, Any]]:
    """Return the files of a finding by stage of progress; text stands for a file that is not JSON."""
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
    found["hostile"] = {name: _poisoned(record) for name, record in FINDING_FILES.items()}
    return found


STAGES = _stages()
"""Files of findings by stage of progress, some broken, one with hostile names."""


_CAMPAIGN: dict[str, Any] = {
    "unit": "planner",
    "fingerprint": "1f3a",
    "failing": 27,
    "tested": 120,
    "findings": ["planner-crash-1f3a"],
    "unconfirmed": [{"signature": "hang of planner", "details": ["still busy"], "repeats": 4}],
    "covered": 256,
    "coverable": 2240,
    "effects": {"injections": 30, "failing": 2, "topics": {"/map": _RATE}, "undecided": {"/odom": 3}},
    "untold": ["silent: nothing on /plan: nominal trials show the same"],
    "rate": _RATE,
    "trials": 128,
    "seconds": 341.0,
}
_UNJUDGED = {"detail": "its process was killed", "occurrences": 3, "injections": [{"topic": "/map"}]}

CAMPAIGNS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "finished": (_CAMPAIGN, ("until activate",)),
    "not finished": (None, ("until test",)),
    "nothing found": (_CAMPAIGN | {"findings": []}, ()),
    "nothing done": (None, ()),
    "inconclusive": (_CAMPAIGN | {"findings": [], "notes": {"rate: nothing came on /plan": 120}}, ()),
    "not judged": (_CAMPAIGN | {"findings": [], "unjudged": [_UNJUDGED]}, ()),
    "several": (_CAMPAIGN, ("until rules", "broken rules", "until test")),
    "broken": ("{", ("until test",)),
    "a broken finding": (_CAMPAIGN, ("broken", "until test")),
    "hostile": (_poisoned(_CAMPAIGN) | {"findings": ["0"]}, ("hostile",)),
}
"""Campaigns by name: `campaign.json`, and the stages of their findings; `broken` is one that cannot be read."""


def campaign_at(name: str, folder: Path) -> CampaignView:
    """Write the files of a campaign into a folder and read them."""
    record, stages = CAMPAIGNS[name]
    folder.mkdir(parents=True, exist_ok=True)
    if record is not None:
        (folder / "campaign.json").write_text(record if isinstance(record, str) else json.dumps(record), "utf-8")
    names = record["findings"] if isinstance(record, dict) else []
    for number, stage in enumerate(stages):
        finding = folder / "findings" / (names[number] if number < len(names) else str(number))
        finding.mkdir(parents=True)
        if stage == "broken":
            (finding / "finding.json").write_text("{", encoding="utf-8")
        else:
            view_at(stage, finding)
    return load_campaign(folder)


def view_at(stage: str, folder: Path) -> FindingView:
    """Write the files of a stage into a folder and read them."""
    for name, record in STAGES[stage].items():
        (folder / name).write_text(record if isinstance(record, str) else json.dumps(record), encoding="utf-8")
    return load(folder)


class ReportConformance:
    """Tests of a report format: it reports any stage of progress, and names in it have no effect.

    Attributes:
        report: The class or other factory of the format.
        markup: Whether `page` of the report is HTML or XML, where names must not become tags.
        binary: Whether the report is not text.
    """

    report: ClassVar[Callable[[], ReportFormat | CampaignFormat]]
    markup: ClassVar[bool] = False
    binary: ClassVar[bool] = False

    def test_its_file_is_a_name_of_its_own(self) -> None:
        """The report's file, in the finding's folder, overwrites none of the finding's own files."""
        file = type(self).report().file
        assert Path(file).name == file
        assert file not in {*_STEP_OF, "campaign.json", "nominal.mcap"}

    @pytest.mark.parametrize("stage", STAGES)
    def test_every_stage_is_reported(self, stage: str, tmp_path: Path) -> None:
        """Missing or broken files raise nothing, the report is not empty, and no file is written."""
        self._is_reported(view_at(stage, tmp_path), tmp_path)

    def test_it_repeats_itself(self, tmp_path: Path) -> None:
        """The same files give the same report."""
        view = view_at("until activate", tmp_path)
        assert self._report(view) == self._report(load(tmp_path))

    def test_hostile_names_stay_text(self, tmp_path: Path) -> None:
        """Names neither move a terminal's cursor nor reorder a line nor become tags or attributes."""
        self._is_harmless(tmp_path, view_at, "until activate")

    def _report(self, view: FindingView | CampaignView) -> str | bytes:
        return render(type(self).report(), view)

    def _is_reported(self, view: FindingView | CampaignView, folder: Path) -> None:
        before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        content = self._report(view)
        assert content
        assert isinstance(content, bytes) if self.binary else self._text(content)
        assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before

    def _is_harmless(
        self, tmp_path: Path, made: Callable[[str, Path], FindingView | CampaignView], harmless: str
    ) -> None:
        if self.binary:
            pytest.skip("this format is not text")
        found = []
        for name in ("hostile", harmless):
            folder = tmp_path / name
            folder.mkdir()
            found.append(self._text(self._report(made(name, folder))))
        kinds = {unicodedata.category(character) for character in found[0] if character not in "\n\t"}
        assert not kinds & {"Cc", "Cf", "Cs", "Zl", "Zp"}
        if self.markup:
            assert _Markup(self.page(found[0])).found <= _Markup(self.page(found[1])).found

    def page(self, text: str) -> str:
        """Return the page that is shown of a report: for Markdown, for instance, the HTML that is made of it."""
        return text

    @staticmethod
    def _text(content: str | bytes) -> str:
        """Return a report as text; raise an error if it is not UTF-8."""
        return content.encode().decode() if isinstance(content, str) else content.decode()


class CampaignReportConformance(ReportConformance):
    """Additional tests of a format that reports campaigns: it reports them however they ended, even unfinished ones."""

    @pytest.mark.parametrize("campaign", CAMPAIGNS)
    def test_every_campaign_is_reported(self, campaign: str, tmp_path: Path) -> None:
        """No result of a campaign raises anything, the report is not empty, and no file is written."""
        self._is_reported(campaign_at(campaign, tmp_path), tmp_path)

    def test_campaigns_that_differ_are_told_apart(self, tmp_path: Path) -> None:
        """An unfinished or inconclusive campaign does not look like a clean one."""
        told = []
        for number, name in enumerate(("nothing found", "nothing done", "inconclusive", "not judged")):
            view = campaign_at(name, tmp_path / str(number) / "out")
            told.append(self._report(replace(view, folder=tmp_path)))
        assert len(set(told)) == len(told)

    def test_hostile_names_of_campaigns_stay_text(self, tmp_path: Path) -> None:
        """Names neither move a terminal's cursor nor reorder a line nor become tags or attributes."""
        self._is_harmless(tmp_path, campaign_at, "finished")


class _Markup(HTMLParser):
    """The tags and attributes of a page."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.found: set[tuple[str, ...]] = set()
        self.feed(source)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found |= {(tag,), *((tag, name) for name, _ in attrs)}
