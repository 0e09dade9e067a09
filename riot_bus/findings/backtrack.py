"""Result of `riot backchain` as data: the way from internal fields to the outside, and the evidence in logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from pydantic import Field

from riot_bus.findings.records import Artefact, _Model
from riot_bus.vocabulary.counting import counted


class EvidenceRecord(_Model):
    """Evidence in the logs that one field follows another; `reason` says why this was not tested."""

    source: str
    target: str
    verdict: str = Field(description="follows, no evidence, or not tested")
    reason: str = ""
    messages: int = Field(default=0, description="messages of the target's topic that it rests on")
    logs: int = 0
    p_value: float | None = None
    follows: str | None = Field(default=None, description="what of the target follows: level or spread")
    strength: float | None = Field(default=None, description="share of what the target's own past leaves open")
    low: float | None = None
    high: float | None = None
    lag_s: float | None = None
    detectable: float | None = Field(default=None, description="share from which on an effect would have shown")

    @property
    def found(self) -> bool:
        """Whether the target follows the source in these logs."""
        return self.verdict == "follows"


class StepRecord(_Model):
    """One step back: a topic, and one that may lead to it; `source` is empty if no topic seems to."""

    source: str
    target: str
    components: tuple[str, ...]
    told: tuple[str, ...] = Field(description="who says that these components read one and write the other")
    evidence: tuple[EvidenceRecord, ...] = ()

    @property
    def inferred(self) -> bool:
        """Whether the step rests on the logs alone."""
        return self.told == ("inferred",)


class BacktrackRecord(Artefact):
    """The way from internal fields back to the outside, by logs alone."""

    FILE = "backchain.json"
    STEP = "backchain"
    targets: dict[str, str] = Field(description="why a field cannot be told of, by field; empty if it can")
    logs: tuple[str, ...]
    messages: int
    looked_at: int
    told: tuple[str, ...] = Field(default=(), description="what tells of the topic graph")
    alpha: float = Field(description="accepted chance of any wrong name per field that was looked at")
    tested: int = Field(description="pairs of fields")
    trees: tuple[dict[str, Any], ...] = ()
    steps: tuple[StepRecord, ...] = ()
    externals: dict[str, str] = Field(default={}, description="who says that the outside controls it, by topic")
    ranking: tuple[EvidenceRecord, ...] = Field(default=(), description="external fields, the most promising first")
    unreachable: tuple[str, ...] = ()
    unwritten: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    loops: tuple[tuple[str, ...], ...] = ()
    unseen: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def summary(self) -> str:
        """Which external fields the targets follow."""
        found = list(dict.fromkeys(one.source for one in self.ranking if one.found))
        names = ", ".join(found) or "no evidence of any"
        return f"{counted(self.looked_at, 'message')} of {counted(len(self.logs), 'log')} -> {names}"


def nodes_of(trees: Sequence[Any]) -> Iterator[tuple[dict[str, Any], str, int]]:
    """Yield each topic of backtrack trees before those that lead to it, with its parent's name and its depth."""
    ahead: list[tuple[Any, str, int]] = [(tree, "", 0) for tree in reversed(trees)]
    while ahead:
        node, parent, depth = ahead.pop()
        if isinstance(node, dict):
            yield node, parent, depth
            hops = node.get("hops")
            below = reversed(hops if isinstance(hops, list) else [])
            ahead += [(hop, str(node.get("topic", "?")), depth + 1) for hop in below]
