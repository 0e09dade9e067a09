from __future__ import annotations

import base64
import hashlib
import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.permeability import PathRecord, PermeabilityRecord, StageRecord
from riot_bus.findings.records import FieldsRecord, FindingRecord, MinimalRecord, RuleRecord
from riot_bus.report.page import write_report
from riot_bus.report.regression import regression_name
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError
from riot_bus_fleet.evidence.text import lines
from tests.unit.riot_bus_fleet.evidence.backtracks import RECORD

SECTIONS = {
    "minimal.json": "minimal",
    "fields.json": "fields",
    "rule.json": "rule",
    "permeability.json": "externals",
    "activation.json": "activation",
}
HOSTILE = (
    "</code></style><script>alert(1)</script>\"'><img src=http://evil.test/x onerror=alert(2)>"
    "\n{{ 7*7 }}\x1b[2J\u202e$\\frac$"
)
VOID = {"meta", "br", "link", "img", "input", "hr"}


class Page(HTMLParser):
    def __init__(self, source: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.open: list[str] = []
        self.ids: list[str] = []
        self.text = ""
        self.css = ""
        self.feed(source)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        self.ids += [value or "" for name, value in attrs if name == "id"]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "style":
            self.css += data
        else:
            self.text += data

    def get(self, *names: str) -> list[str]:
        return [value for _, name, value in self.attributes if name in names]


def read(directory: Path) -> Page:
    return Page(write_report(directory).read_text(encoding="utf-8"))


def flat(page: Page) -> str:
    return " ".join(page.text.split())


def poison(directory: Path, text: str) -> None:
    """Put `text` into every string of every record, keeping what must be of a kind."""

    def spoil(what: object, key: str) -> object:
        if isinstance(what, dict):
            return {(f"{name}{text}" if key in FREE else name): spoil(entry, name) for name, entry in what.items()}
        if isinstance(what, list):
            return [spoil(entry, key) for entry in what]
        return f"{what}{text}" if isinstance(what, str) and key not in {"kind", "version"} else what

    for path in sorted(directory.glob("*.json")):
        path.write_text(json.dumps(spoil(json.loads(path.read_text()), "")))


FREE = {"values", "others", "found", "nominal", "scale", "injections"}


def test_whole_chain(finding: Path) -> None:
    page = read(finding)
    text = flat(page)
    assert not page.open
    assert "planner crashes when /map_updates:x * /map_updates:y < 0 or /map_updates:x" in text
    assert "through /goal:pose.position.x and /goal:pose.position.y: 10 of 10 replays failed again." in text
    assert f"riot reproduce {finding}" in text
    for told in (
        "activated",
        "IndexError: index -4",
        "93 to 99.8 %",
        "-100 ≤ /goal:pose.position.y ≤ -80",
        "Tested for /map_updates:x, no effect found: /imu:angular_velocity.z (p = 0.61)",
        "failed (19)",
        "refused (121)",
        "crash region",
        "nominal values",
        "/battery:voltage",
        "/map_updates └─ /goal by mapper (external)",
        f"riot reproduce {finding} --whole-system",
        "95 %: of such random values at most 3.1 % change the outcome",
        "2 of 2 trials of them failed; with one of them left out, 0 of 1 trial",
        "95 %: they suffice, and none of them can be left out",
    ):
        assert told in text
    assert "The chain ended" not in text
    assert page.tags.count("svg") >= 5


def test_fields_of_several_messages_and_orders_stand_with_their_messages(finding: Path) -> None:
    (one, two), topics = FieldsRecord.load(finding).fields, ("/odom", "/arm", "/odom", "/config")
    names = ("/odom[1]:x", "/arm before /config")
    fields = tuple(each.model_copy(update={"name": name}) for each, name in zip((one, two), names, strict=True))
    FieldsRecord.load(finding).model_copy(update={"fields": fields}).save(finding)
    MinimalRecord.load(finding).model_copy(update={"kept": (1, 2, 3, 4), "topics": topics}).save(finding)
    text = flat(read(finding))
    assert "/odom[0]none: that it arrives is enough" in text
    for told in ("/odom[1]/odom[1]:x-1", "/arm/arm before /config117", "/config/arm before /config117"):
        assert told in text


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({}, "None was confirmed: the 5 fields of these messages hardly matter (95 trials in a row"),
        (
            {"complete": False, "straight": 0},
            "None was confirmed: whether the 5 fields of these messages matter is not",
        ),
        ({"unconfirmed": ("/map_updates:y",)}, "Not confirmed by fresh trials: /map_updates:y."),
        ({"considered": ()}, "None was confirmed."),
    ],
)
def test_that_no_field_was_confirmed_is_no_claim_that_none_matters(
    finding: Path, changes: dict[str, object], told: str
) -> None:
    FieldsRecord.load(finding).model_copy(update={"fields": (), **changes}).save(finding)
    text = flat(read(finding))
    assert told in text
    assert ("that it arrives is enough" in text) == (not {"complete", "unconfirmed"} & changes.keys())
    assert "whatever their fields hold" not in text


def test_messages_that_are_not_proven_to_be_needed_are_called_kept(finding: Path) -> None:
    assert "is needed: without it the failure goes away" in flat(read(finding))
    MinimalRecord.load(finding).model_copy(update={"one_minimal": False}).save(finding)
    text = flat(read(finding))
    assert "The 1 message that was kept" in text
    assert "needed:" not in text


def test_what_logs_alone_say_is_told_as_riot_backchain_tells_it(finding: Path) -> None:
    assert "backtrack" not in read(finding).ids
    RECORD.save(finding)
    page = read(finding)
    assert not page.open
    assert "backtrack" in page.ids
    assert all(line.strip() in page.text for line in lines(RECORD))
    (finding / RECORD.FILE).write_text("{")
    assert f"{RECORD.FILE} cannot be used" in flat(read(finding))


def test_what_else_runs_of_the_whole_system_showed_is_told(finding: Path) -> None:
    more = {"controls": 10, "controls_failed": 1, "unneeded": ("/odom:z",), "others": {"crash in sim: SIGABRT": 3}}
    ActivationRecord.load(finding).model_copy(update=more).save(finding)
    text = flat(read(finding))
    for told in (
        "(1 of 10 runs with nominal values failed so)",
        "does not need /odom:z",
        "the whole system can also fail otherwise: crash in sim: SIGABRT",
        "1 of 10 runs with nominal inputs failed so",
    ):
        assert told in text


def test_what_a_maintainer_can_use_is_linked(finding: Path) -> None:
    record = RuleRecord.load(finding)
    signals = {"map_updates_x": "/map_updates:x"}
    record.model_copy(update={"stl": "always (not (map_updates_x > 3.5))", "stl_signals": signals}).save(finding)
    names = ["sanitize.py", "sanitize.hpp", regression_name(FindingRecord.load(finding))]
    assert not any(name in flat(read(finding)) for name in names)
    for name in names:
        (finding / name).write_text("")
    text = flat(read(finding))
    for told in (*names, "always (not (map_updates_x > 3.5))", "map_updates_x = /map_updates:x"):
        assert told in text
    for command in ("show", "guard"):
        assert f"riot {command} {finding}" in text


@pytest.mark.parametrize("done", range(1, 7))
def test_prefix_of_the_chain(finding: Path, steps: dict[str, str], done: int) -> None:
    files = list(steps)
    for name in files[done:]:
        (finding / name).unlink()
    page = read(finding)
    text = flat(page)
    for name, section in SECTIONS.items():
        assert (section in page.ids) == (name in files[:done])
    for step in list(steps.values())[done:]:
        assert f"The step {step} has no result yet." in text
    following = list(steps.values())[done : done + 1]
    assert [f"riot {step} {finding}" in text for step in following] == [True] * len(following)
    assert ("activated" in text) == (done == 6)
    assert "permeable" in text or done != 5


def test_hole_in_the_chain(finding: Path) -> None:
    (finding / "fields.json").unlink()
    text = flat(read(finding))
    assert f"riot relevance {finding}" in text
    assert "Where the whole system fails" in text


def test_broken_record_is_told(finding: Path) -> None:
    (finding / "rule.json").write_text("{")
    text = flat(read(finding))
    assert "rule.json cannot be used" in text
    assert f"riot rules {finding}" in text


def test_finding_is_needed(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"finding\.json does not exist"):
        write_report(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_what_gets_through_on_the_way_is_told_and_nothing_where_nobody_looked(finding: Path) -> None:
    assert "most permeable path" not in flat(read(finding))
    record = PermeabilityRecord.load(finding)
    stages = tuple(
        StageRecord(topic=field.partition(":")[0], field=field, strength=strength)
        for field, strength in (("/map:width", 0.8), ("/map_updates:x", 0.6))
    )
    path = PathRecord(external="/goal:x", stages=stages, unknown=2)
    follows = {"external": "/goal:x", "internal": "/map:width", "permeable": True, "strength": 0.8}
    silent = follows | {"internal": "/scan:n", "permeable": False}
    hops = [
        {"topic": topic, "component": "mapper", "external": False, "hops": [], "follows": edge}
        for topic, edge in (("/map", follows), ("/scan", silent), ("/image", None))
    ]
    tree = {"topic": "/map_updates", "component": None, "external": False, "hops": hops, "follows": None}
    record.model_copy(update={"paths": (path,), "tree": [tree]}).save(finding)
    text = flat(read(finding))
    told = "/goal:x -> /map:width (0.8) -> /map_updates:x (0.6), as far as is known (2 paths not looked at whole)"
    assert told in text
    assert "/map by mapper: /map:width follows /goal:x (share 0.8)" in text
    assert "/scan by mapper: no effect found in /scan:n" in text
    assert re.search(r"/image by mapper(?!:)", text)


def test_not_found_activation(finding: Path) -> None:
    path = finding / "activation.json"
    record = json.loads(path.read_text())
    path.write_text(
        json.dumps(record | {"found": None, "region": None, "points": [], "replays": 0, "best_distance": 3.5})
    )
    text = flat(read(finding))
    assert "but 200 system runs did not make it fail" in text
    assert "came within 3.5 nominal spreads" in text


def test_a_rule_that_was_met_without_a_failure_is_told_as_such(finding: Path) -> None:
    record = ActivationRecord.load(finding)
    points = (*record.points[:3], record.points[0].model_copy(update={"distance": -0.5, "failed": False}))
    record.model_copy(
        update={"found": None, "region": None, "points": points, "replays": 0, "best_distance": -0.5}
    ).save(finding)
    text = flat(read(finding))
    assert "in 1 of them the rule was met, and the system did not fail" in text
    assert "came within" not in text


def test_parameters_that_were_found_are_named_with_the_replay(finding: Path) -> None:
    assert "activation.mcap goes in." in flat(read(finding))
    ActivationRecord.load(finding).model_copy(update={"found": {"param:planner/inflation": 3.0}}).save(finding)
    assert "activation.mcap goes in, and the parameters that were found are set." in flat(read(finding))


@pytest.mark.parametrize("left_out", [True, False])
def test_what_runs_of_the_whole_system_drove_is_not_called_all(finding: Path, left_out: bool) -> None:
    if not left_out:
        PermeabilityRecord.load(finding).model_copy(update={"pruned": ()}).save(finding)
    text = flat(read(finding))
    assert "In 12 runs of the whole system, external fields got random values: not all of them in each run" in text
    assert ("and some in none (see the end of the page)" in text) == left_out


def test_unconfirmed_activation_is_not_activated(finding: Path) -> None:
    path = finding / "activation.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"replays_failed": 0}))
    text = flat(read(finding))
    assert "but 0 of 10 replays failed again" in text
    assert "permeable finding" in text


def test_loads_nothing(finding: Path) -> None:
    page = read(finding)
    assert not {"script", "link", "img", "iframe", "object", "embed", "base", "form", "image"} & set(page.tags)
    for target in page.get("src", "href", "xlink:href", "srcset", "action", "data"):
        assert target.startswith(("#", "./", "data:"))
    assert not [name for _, name, _ in page.attributes if name == "style" or name.startswith("on")]
    assert "url(" not in page.css
    assert "@import" not in page.css
    assert {target[1:] for target in page.get("href") if target.startswith("#")} <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))


def test_policy_lets_only_our_style_through(finding: Path) -> None:
    page = read(finding)
    policy = next(value for value in page.get("content") if "default-src" in value)
    digest = base64.b64encode(hashlib.sha256(page.css.encode()).digest()).decode()
    assert policy == f"default-src 'none'; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"


def test_hostile_text_stays_text(finding: Path) -> None:
    poison(finding, HOSTILE)
    source = write_report(finding, open_questions=(HOSTILE,)).read_text(encoding="utf-8")
    page = Page(source)
    assert not page.open
    assert not {"script", "img"} & set(page.tags)
    assert not [name for _, name, _ in page.attributes if name.startswith("on") or name == "style"]
    assert all(target.startswith(("#", "./")) for target in page.get("src", "href"))
    assert "alert(1)" in page.text
    assert "{{ 7*7 }}" in page.text
    assert "\x1b" not in source
    assert "\u202e" not in source
    assert "evil" not in page.css


@pytest.mark.parametrize(
    "log", ["javascript:alert(1)", "/etc/passwd", "../../x.mcap", "https://evil.test/x", "//evil.test/x"]
)
def test_links_stay_below_the_page(finding: Path, log: str) -> None:
    path = finding / "fields.json"
    path.write_text(path.read_text().replace("trials/x-fails.mcap", log))
    page = read(finding)
    assert log in page.text
    for target in page.get("href"):
        assert target.startswith(("#", "./"))
        assert ".." not in target
        assert ":" not in target


def test_huge_records_make_a_small_page(finding: Path) -> None:
    poison(finding, "<&" * 20_000)
    fields = json.loads((finding / "fields.json").read_text())
    fields["fields"] *= 200
    fields["considered"] *= 500
    (finding / "fields.json").write_text(json.dumps(fields))
    assert write_report(finding).stat().st_size < 1_500_000


def test_many_points_make_a_small_page(finding: Path) -> None:
    for name, key in (("activation.json", "points"), ("rule.json", "samples")):
        record = json.loads((finding / name).read_text())
        record[key] *= 100
        (finding / name).write_text(json.dumps(record))
    path = write_report(finding)
    assert path.stat().st_size < 1_500_000
    assert "th drawn" in path.read_text()


def test_deterministic(finding: Path) -> None:
    first = write_report(finding).read_bytes()
    assert write_report(finding).read_bytes() == first
    assert not list(finding.glob("*.part"))


def test_missing_jinja2(finding: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(MissingExtraError, match="jinja2"):
        write_report(finding)


def test_directory_is_quoted(finding: Path) -> None:
    odd = finding / "a b;c"
    odd.mkdir()
    (odd / "finding.json").write_text((finding / "finding.json").read_text())
    assert f"riot reproduce '{odd}'" in flat(read(odd))
