"""What a report claims of a rule is what its record counts; the other claims are read on the page (test_page.py)."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import (
    AbsentRecord,
    AlternativeRecord,
    FieldsRecord,
    MinimalRecord,
    ProportionRecord,
    RuleRecord,
    SimplifiedRecord,
    StructureRecord,
)
from riot_bus.report.finding_view import load
from riot_bus.report.page import write_report
from riot_bus.report.statements import Statement, not_tried, statements
from riot_bus_testkit.reports import view_at


def told(folder: Path, **changes: object) -> list[Statement]:
    """Return the claims of a finding whose rule has some other values."""
    view_at("until activate", folder)
    RuleRecord.load(folder).model_copy(update=changes).save(folder)
    return statements(load(folder))


def test_a_rule_is_told_with_the_trials_behind_it_and_nothing_without_trials(tmp_path: Path) -> None:
    right = ProportionRecord(value=22 / 24, low=0.73, high=0.99, count=22, total=24)
    none = ProportionRecord(value=1.0, low=0.0, high=1.0)
    found = {one.claim: one for one in told(tmp_path, in_context=right, in_campaign=none)}
    context = found["with nominal messages first, the rule is right"]
    assert context.evidence.replace("\N{NO-BREAK SPACE}", " ") == "22 of 24 fresh trials"
    assert context.confidence == "95 %: 73 to 99 %"
    assert not [claim for claim in found if "campaign" in claim]


def test_of_a_failure_that_comes_sometimes_it_is_told_how_often_it_came_where_the_rule_holds(tmp_path: Path) -> None:
    right = ProportionRecord(value=1.0, low=0.9, high=1.0, count=40, total=40)
    (one,) = [each for each in told(tmp_path, in_campaign=right, held=(9, 30)) if "campaign" in each.claim]
    assert one.claim.replace("\N{NO-BREAK SPACE}", " ").endswith(
        "(of 30 trials in which it holds, 9 failed: passing ones are left out)"
    )
    assert "; 9 of 30 trials in which it holds failed" in RuleRecord.load(tmp_path).summary


def test_trials_that_the_rule_cannot_judge_are_told(tmp_path: Path) -> None:
    told(tmp_path, unjudged=12)
    gaps = [gap.replace("\N{NO-BREAK SPACE}", " ") for gap in not_tried(load(tmp_path))]
    assert "Whether the rule is right in 12 earlier trials is not known: messages lack fields of it." in gaps


@pytest.mark.parametrize("count", [1, 2])
def test_other_rules_that_explain_all_trials_are_told_with_what_would_decide(tmp_path: Path, count: int) -> None:
    others = tuple(
        AlternativeRecord(text=f"x < {number}", rule={}, decided_by={"x": number - 1}) for number in range(count)
    )
    found = [one for one in told(tmp_path, alternatives=others) if "may as well be" in one.claim]
    assert [one.claim for one in found] == [f"the rule may as well be: x < {number}" for number in range(count)]
    assert found[0].confidence == "would be decided by x = -1"


def test_what_was_made_simpler_and_what_is_missing_is_told(tmp_path: Path) -> None:
    view_at("until activate", tmp_path)
    simpler = SimplifiedRecord(what="value", name="/cmd:x", before=-7341, after=-1)
    absent = AbsentRecord(numbers=(4,), topics=("/config",), passed=(3, 3))
    MinimalRecord.load(tmp_path).model_copy(
        update={"simplified": (simpler,), "simplified_trials": 6, "absent": absent}
    ).save(tmp_path)
    found = {one.claim: one for one in statements(load(tmp_path))}
    missing = found["it fails since messages are missing (/config)"]
    assert "with message number 4 of the nominal log, 3 of 3" in missing.evidence
    page = write_report(tmp_path).read_text()
    assert "/cmd:x: -7341 -&gt; -1" in page
    assert "fails since /config (number 4 of the nominal log) is missing" in page


def test_what_besides_values_matters_is_told_with_its_trials(tmp_path: Path) -> None:
    view_at("until activate", tmp_path)
    order = StructureRecord(
        kind="order", name="/a", then="/b", failing_log="f", passing_log="p", failed=(3, 3), passed=(4, 4)
    )
    known = {"key": 2, "missing key": 1, "order": 2}
    FieldsRecord.load(tmp_path).model_copy(
        update={"structure": (order,), "structure_known": known, "structure_failed": (2, 2)}
    ).save(tmp_path)
    view = load(tmp_path)
    found = {one.claim: one for one in statements(view)}
    assert "3 of 3 failed, 4 of 4 passed" in found["the failure needs that /a comes before /b"].evidence
    likewise = found["it fails likewise with other keys (3 asked), other orders of neighbours (1 asked)"]
    assert likewise.evidence.replace("\N{NO-BREAK SPACE}", " ").endswith("2 of 2 trials failed")
    assert not any("is not known" in gap for gap in not_tried(view)), "one message has no times between messages"


@pytest.mark.parametrize(
    ("known", "kept", "gap"),
    [
        ({}, 1, "Whether other keys matter"),
        ({}, 2, "Whether other keys or other orders of neighbours or longer times between messages matter"),
        ({"key": 3}, 2, "Whether longer times between messages matter"),
        ({"order": 0, "gap": 0}, 2, "Whether other orders of neighbours or longer times between messages matter"),
        ({"key": 0, "missing key": 1, "gap": 1}, 2, None),
    ],
)
def test_what_was_not_asked_besides_values_is_named(
    tmp_path: Path, known: dict[str, int], kept: int, gap: str | None
) -> None:
    view_at("until activate", tmp_path)
    MinimalRecord.load(tmp_path).model_copy(update={"kept": tuple(range(kept))}).save(tmp_path)
    FieldsRecord.load(tmp_path).model_copy(update={"structure_known": known}).save(tmp_path)
    told = [each for each in not_tried(load(tmp_path)) if "matter is not known" in each]
    assert told == ([f"{gap} is not known."] if gap else [])


def test_what_was_left_out_is_named(tmp_path: Path) -> None:
    view_at("until activate", tmp_path)
    FieldsRecord.load(tmp_path).model_copy(update={"left": ("/map:stamp", "/map:crc")}).save(tmp_path)
    gaps = not_tried(load(tmp_path))
    assert any(gap.startswith("2") and gap.endswith("alone: /map:stamp, /map:crc") for gap in gaps)
    assert "Whether the rule holds in longer logs than the minimal one was not asked." in gaps
    right = ProportionRecord(value=1.0, low=0.7, high=1.0, count=9, total=9)
    RuleRecord.load(tmp_path).model_copy(update={"in_campaign": right}).save(tmp_path)
    assert not any("longer logs" in gap for gap in not_tried(load(tmp_path)))


@pytest.mark.parametrize("failed", [(0, 0), (0, 3)])
def test_messages_that_no_trial_has_failed_with_are_not_said_to_suffice(
    tmp_path: Path, failed: tuple[int, int]
) -> None:
    view_at("until activate", tmp_path)
    MinimalRecord.load(tmp_path).model_copy(update={"failed": failed, "one_minimal": False}).save(tmp_path)
    (found,) = (one for one in statements(load(tmp_path)) if "of 5012" in one.claim)
    assert (found.claim, found.confidence) == ("1 message of 5012 was kept", "not known whether they suffice")


def test_what_was_not_tested_is_not_called_absent(finding: Path) -> None:
    untested = {"/joy:axes[0]": "no internal field had values by which it could be told"}
    for edges, claimed in (((), False), (PermeabilityRecord.load(finding).edges, True)):
        silent = tuple(edge.model_copy(update={"permeable": False}) for edge in edges)
        record = PermeabilityRecord.load(finding).model_copy(update={"edges": silent, "untested": untested})
        record = record.model_copy(update={"unseen": {"/map_updates:z": "it had no value in any long run"}})
        record.save(finding)
        (finding / ActivationRecord.FILE).unlink(missing_ok=True)
        view = load(finding)
        absent = "no external field that was tested reaches a relevant one"
        assert any(one.claim == absent for one in statements(view)) == claimed
        told = "".join(part.text for part in view.verdict())
        assert ("none of the external fields that were tested reaches it" in told) == claimed
        assert ("whether any external field reaches it could not be determined" in told) == (not claimed)
        assert any("1 external field not tested (no internal field had values" in gap for gap in not_tried(view))
        assert "What reaches /map_updates:z from outside: it had no value in any long run." in not_tried(view)


def test_what_replays_do_not_confirm_is_no_activation(finding: Path) -> None:
    claim = "external inputs alone make the whole system fail"
    assert claim in {one.claim for one in statements(load(finding))}
    for changes in ({"replays_failed": 0}, {"replays_failed": 1, "controls": 10, "controls_failed": 1}):
        ActivationRecord.load(finding).model_copy(update=changes).save(finding)
        found = {one.claim: one.confidence for one in statements(load(finding))}
        assert claim not in found
        assert found["one run of the whole system failed with the external inputs that were found"] == (
            "not confirmed by replays"
        )


def test_the_crash_region_is_told_with_the_runs_that_it_was_drawn_by(finding: Path) -> None:
    (region,) = (one for one in statements(load(finding)) if "crash region" in one.claim)
    assert region.evidence == "39 of 40 runs inside failed"
    assert region.confidence == "it was drawn by these runs, so they do not test it"
    record = ActivationRecord.load(finding)
    assert record.region
    one = record.region.model_copy(update={"ranges": record.region.ranges[:1]})
    assert any("drawn over 2 external fields:" in gap for gap in not_tried(load(finding)))
    record.model_copy(update={"region": one}).save(finding)
    assert any("drawn over 1 external field:" in gap for gap in not_tried(load(finding)))


def test_a_log_in_place_of_the_outside_is_told(finding: Path) -> None:
    assert not any("How the outside answers" in gap for gap in not_tried(load(finding)))
    PermeabilityRecord.load(finding).model_copy(update={"played": True}).save(finding)
    assert any("How the outside answers" in gap for gap in not_tried(load(finding)))
