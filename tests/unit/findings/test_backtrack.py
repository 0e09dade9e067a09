from __future__ import annotations

from riot_bus.findings.backtrack import BacktrackRecord, EvidenceRecord, StepRecord


def test_a_record_sums_itself_up():
    ranking = tuple(
        EvidenceRecord(source=name, target="unit:v", verdict=verdict)
        for name, verdict in (("goal:x", "follows"), ("goal:y", "no evidence"), ("odom:x", "follows"))
    )
    record = BacktrackRecord(
        targets={"unit:v": ""}, logs=("a", "b"), messages=10, looked_at=10, alpha=0.01, tested=3, ranking=ranking
    )
    assert record.summary == "10 messages of 2 logs -> goal:x, odom:x"
    assert "no evidence of any" in record.model_copy(update={"ranking": ranking[1:2]}).summary


def test_a_step_is_inferred_only_if_nobody_else_tells_it():
    assert StepRecord(source="a", target="b", components=("c",), told=("inferred",)).inferred
    assert not StepRecord(source="a", target="b", components=("c",), told=("riot.toml",)).inferred
