"""A way back with one of everything that has to be shown."""

from __future__ import annotations

from riot_bus.findings.backtrack import BacktrackRecord, EvidenceRecord, StepRecord


def hop(topic, component=None, *hops, external=False, loop=False, cut=False, again=False):
    marks = {"external": external, "loop": loop, "cut": cut, "again": again}
    return {"topic": topic, "component": component, **marks, "hops": list(hops)}


def follows(source, target, **more):
    known = {"messages": 1200, "logs": 4, "p_value": 0.005, "follows": "level", "strength": 0.123, "low": 0.1}
    known |= {"high": 0.15, "lag_s": 0.055}
    return EvidenceRecord(source=source, target=target, verdict="follows", **(known | more))


def silent(source, target):
    return EvidenceRecord(
        source=source, target=target, verdict="no evidence", messages=1200, logs=4, p_value=0.4, detectable=0.008
    )


def untested(source, target, reason="it never changes within a log"):
    return EvidenceRecord(source=source, target=target, verdict="not tested", reason=reason)


def step(source, *evidence, target="/unit", by="planner", told="riot.toml"):
    return StepRecord(source=source, target=target, components=(by,), told=(told,), evidence=evidence)


ODD = '/odd"\\\x1b'
TREE = hop(
    "/unit",
    None,
    hop("/map", "planner", hop("/goal", "mapper", external=True), hop("/unit", "mapper", loop=True)),
    hop("/odom", "planner", external=True),
    hop(ODD, "unknown writer of /unit"),
    hop("/lost", "planner"),
)

RECORD = BacktrackRecord(
    targets={"/unit:v": "", "/unit:w": "it never changes within a log"},
    logs=("a.mcap", "b.mcap", "c.mcap", "d.mcap"),
    messages=21_258,
    looked_at=6_000,
    told=("riot.toml",),
    alpha=0.01,
    tested=68,
    trees=(TREE,),
    steps=(
        step("/map", follows("/map:x", "/unit:v")),
        step("/odom", silent("/odom:x", "/unit:v")),
        step("/goal", untested("/goal:x", "/map:x"), target="/map", by="mapper"),
        step("/unit", target="/map", by="mapper"),
        step(
            ODD,
            follows(f"{ODD}:x", "/unit:v", follows="spread", lag_s=2.0),
            by="unknown writer of /unit",
            told="inferred",
        ),
        step("/lost"),
        step("", silent("/x:x", "/odom:x"), target="/odom", by="", told="inferred"),
    ),
    externals={"/goal": "riot.toml", "/odom": "nothing recorded leads to it", "/joy": "riot.toml"},
    ranking=(follows("/goal:y", "/unit:v"), silent("/odom:x", "/unit:v"), untested("/goal:x", "/unit:v")),
    unreachable=("/joy",),
    unwritten=("/odom",),
    missing=("/lost",),
    loops=(("/map", "/unit"),),
    unseen=("/map:z",),
    notes=("28% of the time was looked at",),
)
