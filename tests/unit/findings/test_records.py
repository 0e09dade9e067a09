from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.records import (
    CampaignRecord,
    EffectsRecord,
    FieldsRecord,
    FindingRecord,
    ProportionRecord,
    RuleRecord,
)
from riot_bus.vocabulary.errors import ConfigError

CAMPAIGN = CampaignRecord(unit="planner", fingerprint="f", failing=2, findings=("a",), seed=3, trials=40)


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    assert not CampaignRecord.exists(tmp_path)
    assert CAMPAIGN.save(tmp_path) == tmp_path / "campaign.json"
    assert CampaignRecord.exists(tmp_path)
    assert CampaignRecord.load(tmp_path) == CAMPAIGN
    assert [path.name for path in tmp_path.iterdir()] == ["campaign.json"]


def test_a_missing_record_names_the_step_that_writes_it(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="does not exist yet") as caught:
        ActivationRecord.load(tmp_path)
    assert caught.value.where == str(tmp_path)
    assert "riot activate" in str(caught.value.hint)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"version": 2, "unit": "u", "fingerprint": "f"}', '{"unit": "u"}'])
def test_a_record_that_cannot_be_used_is_an_error_that_says_which(tmp_path: Path, text: str) -> None:
    (tmp_path / "campaign.json").write_text(text)
    with pytest.raises(ConfigError, match="cannot be used") as caught:
        CampaignRecord.load(tmp_path)
    assert caught.value.where == str(tmp_path / "campaign.json")
    assert "riot test" in str(caught.value.hint)


def test_fields_of_a_later_release_are_passed_over(tmp_path: Path) -> None:
    path = CAMPAIGN.save(tmp_path)
    path.write_text(json.dumps({**json.loads(path.read_text()), "later": 1}))
    assert CampaignRecord.load(tmp_path) == CAMPAIGN


def test_what_has_failed_is_told_by_name_and_the_rest_in_a_line() -> None:
    def rate(count: int, total: int, high: float) -> ProportionRecord:
        return ProportionRecord(value=count / total, low=0.0, high=high, count=count, total=total)

    topics = {"a": rate(0, 9, 0.34), "b": rate(1, 4, 0.81), "c": rate(0, 5, 0.52)}
    effects = EffectsRecord(injections=18, topics=topics, classes={"int8": rate(0, 18, 0.19)})
    assert effects.lines()[1:] == [
        "tried on topic b: 1 of 4 failed alone, 95 %: 0.0% to 81.0%",
        "tried on 2 other topics: 0 of 14 failed alone, 95 %: at most 52.0% of each",
        "tried on 1 field class: 0 of 18 failed alone, 95 %: at most 19.0% of each",
    ]
    effects = effects.model_copy(update={"undecided": {"a": 2, "b": 1}})
    assert effects.lines()[1:] == [
        "tried on topic b: 1 of 4 failed alone",
        "tried on 2 other topics: 0 of 14 failed alone",
        "tried on 1 field class: 0 of 18 failed alone",
        "failed only together with others, so that no share is known there: 2 on a, 1 on b; "
        "`riot test --covered` tells these apart",
    ]


def test_findings_are_ranked_by_the_crash_scale_then_by_ease() -> None:
    def record(severity: str, rate: float, modified: int) -> FindingRecord:
        proportion = ProportionRecord(value=rate, low=0.0, high=1.0)
        given = dict.fromkeys(("id", "system", "system_file", "unit", "component", "monitor", "signature"), "x")
        return FindingRecord(**given, severity=severity, rate=proportion, modified=modified)  # type: ignore[arg-type]

    ranked = [
        record("restart", 0.1, 9),
        record("abort", 1.0, 1),
        record("abort", 1.0, 2),
        record("abort", 0.5, 1),
        record("silent", 1.0, 1),
    ]
    mixed = [ranked[place] for place in (3, 0, 4, 2, 1)]
    assert sorted(mixed, key=lambda one: one.rank) == ranked


def test_a_rule_about_yes_and_no_says_how_few_cases_it_has() -> None:
    sure = ProportionRecord(value=1, low=0.9, high=1, count=30, total=30)
    rule = RuleRecord(
        text="/a before /b", rule={}, precision=sure, recall=sure, balanced_accuracy=1.0, checks=60, scale={}
    )
    assert "1.000 on 60 fresh checks, 0 trials" in rule.summary
    yes = rule.model_copy(update={"types": {"/a before /b": "bool"}})
    assert "1.000 on 60 fresh checks of its 2 cases, 0 trials" in yes.summary
    mixed = rule.model_copy(update={"types": {"/a before /b": "bool", "/b:x": "int32"}})
    assert "of its" not in mixed.summary


def test_a_path_that_begins_at_the_findings_folder_is_a_whole_one_when_it_is_read(tmp_path: Path) -> None:
    folder = tmp_path / "kept" / "findings" / "x"
    folder.mkdir(parents=True)
    for written, read in (
        ("../../../riot.toml", tmp_path / "riot.toml"),
        ("/site/riot.toml", Path("/site/riot.toml")),
        ("rover/riot.toml", Path("rover/riot.toml")),
    ):
        FindingRecord(
            id="x", system="s", system_file=written, unit="u", component="u", monitor="crash", signature="crash in u"
        ).save(folder)
        assert Path(FindingRecord.load(folder).system_file) == read


@pytest.mark.parametrize(
    ("straight", "told"),
    [
        (95, "at most 3.1% of random values of the others change the outcome (95 %)"),
        (0, "whether the others matter is not known"),
    ],
)
def test_what_is_known_of_the_other_fields_is_told_with_the_relevant_ones(straight: int, told: str) -> None:
    record = FieldsRecord(fields=(), considered=("/a:x", "/a:y"), bound=0.031, straight=straight, unconfirmed=("/a:x",))
    assert record.summary == f"2 fields -> /a:x (unconfirmed) (0 trials); {told}"
    assert "others" not in record.model_copy(update={"considered": ("/a:x",)}).summary
