from __future__ import annotations

import math
import random
from pathlib import Path

import pytest

from riot_bus.findings.activation import ActivationRecord, PointRecord, RangeRecord, RegionRecord
from riot_bus.findings.permeability import EdgeRecord, PermeabilityRecord
from riot_bus.findings.records import (
    Artefact,
    CertificateRecord,
    FieldRecord,
    FieldsRecord,
    FindingRecord,
    MinimalRecord,
    ProportionRecord,
    RuleRecord,
    RuleSample,
)

STEPS = {
    "finding.json": "test",
    "minimal.json": "minimize",
    "fields.json": "relevance",
    "rule.json": "rules",
    "permeability.json": "permeability",
    "activation.json": "activate",
}
X, Y = "/map_updates:x", "/map_updates:y"
GOAL_X, GOAL_Y = "/goal:pose.position.x", "/goal:pose.position.y"
RULE = f"{X} * {Y} < 0 or {X} * {Y} > 4194304"


def _wide(chance: random.Random) -> float:
    return float(chance.choice([-1, 1]) * math.floor(10 ** chance.uniform(0, 9.3)))


def _samples() -> tuple[RuleSample, ...]:
    chance = random.Random(1)
    pairs = [(_wide(chance), _wide(chance)) for _ in range(120)]
    pairs += [(chance.randint(0, 300), chance.randint(0, 300)) for _ in range(120)]
    return tuple(RuleSample(values={X: x, Y: y}, failed=x * y < 0 or x * y > 4194304) for x, y in pairs)


def _points() -> tuple[PointRecord, ...]:
    chance = random.Random(2)
    wide = [(chance.uniform(-5000, 5000), chance.uniform(-5000, 5000)) for _ in range(90)]
    near = [(chance.gauss(0, 60), chance.gauss(-70, 30)) for _ in range(110)]
    points = []
    for x, y in wide + near:
        inside = abs(x) <= 100 and abs(y) <= 100
        failed = inside and y < -80
        distance = (y + 80) / 10 if inside else None
        points.append(PointRecord(values={GOAL_X: x, GOAL_Y: y}, distance=distance, failed=failed))
    return tuple(points)


def rover() -> list[Artefact]:
    def certificate(failing: int, passing: int, other: str, name: str) -> CertificateRecord:
        return CertificateRecord(
            failing=failing,
            passing=passing,
            others={other: 117},
            failing_log=f"trials/{name}-fails.mcap",
            passing_log=f"trials/{name}-passes.mcap",
            confirmed_failing=5,
            confirmed_passing=5,
            repeats=5,
        )

    def edge(external: str, internal: str, strength: float, *, p_value: float = 0.005) -> EdgeRecord:
        return EdgeRecord(
            external=external,
            internal=internal,
            permeable=p_value < 0.05,
            strength=strength,
            low=max(0.0, strength - 0.08),
            high=min(1.0, strength + 0.07),
            lag_s=0.4,
            p_value=p_value,
        )

    return [
        FindingRecord(
            id="planner-crash-1f3a",
            system="rover",
            system_file="examples/rover/riot.toml",
            unit="planner",
            component="planner",
            monitor="crash",
            signature="IndexError in costmap.py:update_window <- planner.py:on_map_update",
            details=(
                "Traceback (most recent call last):",
                '  File "rover/planner.py", line 88, in on_map_update',
                "    self.costmap.update_window(update)",
                "IndexError: index -4 is out of bounds for axis 0 with size 400",
            ),
            occurrences=3,
            injections=({"topic": "/map_updates", "field": "x", "value": -1, "from": 12.0, "until": 20.0},),
            messages=5012,
            modified=38,
            seed=7,
            trials=212,
            seconds=341.0,
        ),
        MinimalRecord(
            before=5012,
            kept=(3391,),
            topics=("/map_updates",),
            one_minimal=True,
            confidence=0.95,
            failed=(2, 2),
            without=((0, 1),),
            trials=31,
            seconds=40.2,
        ),
        FieldsRecord(
            fields=(
                FieldRecord(
                    name=X, kind="exceptional", type="int32", failing=-1, certificate=certificate(-1, 52, Y, "x")
                ),
                FieldRecord(
                    name=Y, kind="nominal", type="int32", failing=117, certificate=certificate(117, -3, X, "y")
                ),
            ),
            considered=(X, Y, "/map_updates:width", "/map_updates:height", "len(/map_updates:data)"),
            bound=0.031,
            straight=95,
            trials=141,
            seconds=71.0,
        ),
        RuleRecord(
            text=RULE,
            rule={},
            python=f"def rule(v):\n    '{RULE}'\n    return (\n        (v['{X}'] * v['{Y}'] < 0)\n    )\n",
            precision=ProportionRecord(value=1.0, low=0.963, high=1.0, count=98, total=98),
            recall=ProportionRecord(value=0.98, low=0.931, high=0.998, count=98, total=100),
            balanced_accuracy=0.99,
            scale={X: 40.0, Y: 40.0},
            samples=_samples(),
            trials=440,
            seconds=205.0,
        ),
        PermeabilityRecord(
            edges=(
                edge(GOAL_X, X, 0.61),
                edge("/odom:twist.twist.linear.x", X, 0.12),
                edge("/imu:angular_velocity.z", X, 0.01, p_value=0.61),
                edge(GOAL_Y, Y, 0.66),
                edge("/odom:twist.twist.linear.y", Y, 0.09),
                edge("/imu:angular_velocity.z", Y, 0.0, p_value=0.84),
            ),
            runs=12,
            pruned=("/battery:voltage",),
            tree=[
                {
                    "topic": "/map_updates",
                    "component": None,
                    "hops": [
                        {"topic": "/goal", "component": "mapper", "external": True, "hops": []},
                        {"topic": "/odom", "component": "mapper", "external": True, "hops": []},
                    ],
                }
            ],
            nominal={GOAL_X: (0.0, 60.0), GOAL_Y: (10.0, 50.0)},
            trials=12,
            seconds=380.0,
        ),
        ActivationRecord(
            found={GOAL_X: 12.5, GOAL_Y: -91.25},
            runs=200,
            best_distance=-1.2,
            replays=10,
            replays_failed=10,
            region=RegionRecord(
                ranges=(RangeRecord(field=GOAL_X, low=-100, high=100), RangeRecord(field=GOAL_Y, low=-100, high=-80)),
                inside=ProportionRecord(value=0.98, low=0.88, high=1.0, count=39, total=40),
            ),
            points=_points(),
            messages=2,
            trials=250,
            seconds=1650.0,
        ),
    ]


@pytest.fixture
def finding(tmp_path: Path) -> Path:
    for record in rover():
        record.save(tmp_path)
    return tmp_path


@pytest.fixture
def steps() -> dict[str, str]:
    """The files of a finding in the order of the chain, with the step that writes each."""
    return dict(STEPS)
