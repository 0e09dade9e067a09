from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.findings.comparison import compare
from riot_bus.findings.records import CampaignRecord, FindingRecord, ProportionRecord, UnconfirmedRecord
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.errors import ConfigError


def campaign(folder: Path, **rates: tuple[int, int]) -> Path:
    for name, (hits, total) in rates.items():
        found = proportion(hits, total)
        (folder / "findings" / name).mkdir(parents=True)
        FindingRecord(
            id=name,
            system="s",
            system_file="riot.toml",
            unit="u",
            component="u",
            monitor="crash",
            severity="abort",
            signature=f"crash in u: {name}",
            rate=ProportionRecord(value=found.rate, low=found.low, high=found.high, count=hits, total=total),
        ).save(folder / "findings" / name)
    folder.mkdir(exist_ok=True)
    CampaignRecord(unit="u", fingerprint="f", failing=5, tested=50, trials=70, findings=tuple(rates)).save(folder)
    return folder


def test_what_has_become_of_each_failure(tmp_path: Path) -> None:
    old = campaign(tmp_path / "old", gone=(4, 4), same=(4, 4), rarer=(20, 20), worse=(1, 20))
    new = campaign(tmp_path / "new", fresh=(4, 4), same=(3, 4), rarer=(2, 20), worse=(20, 20))
    found = compare(old, new)
    assert [(each.change, each.signature.rpartition(" ")[2]) for each in found.findings] == [
        ("new", "fresh"),
        ("comes more often", "worse"),
        ("still failing", "same"),
        ("comes less often", "rarer"),
        ("not seen", "gone"),
    ]
    lines = list(found.lines())
    assert lines[0] == "new               crash in u: fresh (fresh trials: - -> 4 of 4, 95 %: 40% to 100%)"
    assert lines[-1].startswith("new: 5 of 50 trials failed, 95 %: 3.3% to 21.8%")
    assert found.to_json()["findings"][4]["new"] is None


def test_a_folder_without_a_campaign(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"campaign\.json"):
        compare(tmp_path, tmp_path)


def test_what_one_campaign_has_not_confirmed_counts_with_the_rate_of_its_repeats(tmp_path: Path) -> None:
    old = campaign(tmp_path / "old", always=(4, 4), rare=(3, 20))
    new = campaign(tmp_path / "new", back=(20, 20))
    for folder, names in ((old, ("back",)), (new, ("always", "rare", "nobody"))):
        again = tuple(UnconfirmedRecord(signature=f"crash in u: {name}", repeats=20) for name in names)
        CampaignRecord.load(folder).model_copy(update={"unconfirmed": again}).save(folder)
    found = {each.signature.rpartition(" ")[2]: each for each in compare(old, new).findings}
    changes = {name: each.change for name, each in found.items()}
    assert changes == {"always": "comes less often", "rare": "still failing", "back": "comes more often"}
    assert {each.severity for each in found.values()} == {"abort"}
    lines = list(compare(old, new).lines())
    assert "(fresh trials: 4 of 4, 95 %: 40% to 100% -> 0 of 20, 95 %: 0% to 17%)" in lines[-3]


def test_what_came_again_too_seldom_to_be_confirmed_counts_as_often_as_it_came(tmp_path: Path) -> None:
    old, new = campaign(tmp_path / "old", rare=(3, 20)), campaign(tmp_path / "new")
    again = (UnconfirmedRecord(signature="crash in u: rare", hits=1, repeats=20),)
    CampaignRecord.load(new).model_copy(update={"unconfirmed": again}).save(new)
    assert "-> 1 of 20, 95 %: 0% to 25%)" in next(compare(old, new).lines())


def test_what_another_campaign_has_found_of_the_same_code_was_seen(tmp_path: Path) -> None:
    old, new = campaign(tmp_path / "old", same=(4, 4)), campaign(tmp_path / "new", same=(4, 4))
    CampaignRecord.load(new).model_copy(update={"findings": ()}).save(new)
    record = FindingRecord.load(new / "findings" / "same")
    for changes, change in (
        ({"fingerprint": "f"}, "still failing"),
        ({"fingerprint": "other"}, "not seen"),
        ({"fingerprint": "f", "unit": "another"}, "not seen"),
        ({"fingerprint": "f", "whole_system": True}, "not seen"),
    ):
        record.model_copy(update=changes).save(new / "findings" / "same")
        assert [each.change for each in compare(old, new).findings] == [change]
    CampaignRecord.load(new).model_copy(update={"findings": ("same",)}).save(new)
    (new / "findings" / "same-missing").mkdir()
    record.model_copy(update={"fingerprint": "f", "rate": None}).save(new / "findings" / "same-missing")
    record.save(new / "findings" / "same")
    assert next(compare(old, new).lines()).endswith("-> 4 of 4, 95 %: 40% to 100%)")


def test_campaigns_of_two_units_cannot_be_compared(tmp_path: Path) -> None:
    old, new = campaign(tmp_path / "old"), campaign(tmp_path / "new")
    CampaignRecord.load(new).model_copy(update={"unit": "other"}).save(new)
    with pytest.raises(ConfigError, match="two units: 'u' and 'other'"):
        compare(old, new)


def test_campaigns_on_a_unit_and_on_its_system_cannot_be_compared(tmp_path: Path) -> None:
    old, new = campaign(tmp_path / "old"), campaign(tmp_path / "new")
    CampaignRecord.load(new).model_copy(update={"whole_system": True}).save(new)
    with pytest.raises(ConfigError, match="one campaign is of the unit alone, one of the whole system"):
        compare(old, new)
