"""External inputs that make the whole system fail, and the region around them: `activation.json` (RIOT II-D)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from pydantic import Field

from riot_bus.findings.records import PLAYED, Artefact, ProportionRecord, Value, _Model
from riot_bus.vocabulary.counting import counted


class PointRecord(_Model):
    """One run of the whole system: external values, the least distance to the rule, and whether it failed."""

    values: dict[str, Value]
    distance: float | None
    failed: bool
    phase: str = "search"


class RangeRecord(_Model):
    """Interval of one external field in the region where the whole system fails, in the field's unit; limits included.

    `ends` names limits that are ends of the range that was searched: a run there failed, and nothing beyond was tried.
    """

    field: str
    low: float
    high: float
    ends: tuple[Literal["low", "high"], ...] = Field(default=(), description="ends beyond which nothing was tried")

    def text(self, number: Callable[[float], str] = "{:.4g}".format) -> str:
        """Return the range as text; `number` formats a number."""
        low, high = number(self.low), number(self.high)
        if len(self.ends) > 1:
            return f"{self.field} anywhere from {low} to {high}, as far as was tried"
        if "low" in self.ends:
            return f"{self.field} <= {high} (tried from {low} on)"
        return f"{self.field} >= {low} (tried up to {high})" if self.ends else f"{low} <= {self.field} <= {high}"


class RegionRecord(_Model):
    """Ranges of external fields within which the whole system fails, with the others as in the point that was found."""

    ranges: tuple[RangeRecord, ...]
    inside: ProportionRecord | None = None
    text: str = ""
    rule: str = Field(default="", description="as a rule over external fields, which `region/rule.json` has as data")

    def bounds(self, number: Callable[[float], str] = "{:.4g}".format) -> tuple[str, ...]:
        """Return the range of each field as text; `number` formats a number."""
        return tuple(each.text(number) for each in self.ranges)


class ActivationRecord(Artefact):
    """Result of the search for external inputs that make the whole system fail (RIOT II-D)."""

    FILE = "activation.json"
    STEP = "activate"
    found: dict[str, Value] | None
    runs: int
    best_distance: float | None = Field(description="least distance to the rule over all runs; 0 or less: it was met")
    replays: int = 0
    replays_failed: int = 0
    region: RegionRecord | None = None
    points: tuple[PointRecord, ...] = ()
    messages: int = Field(default=0, description="external messages of each replay")
    needed: int = Field(default=0, description="external messages that are enough; 0 if that was not found out")
    needed_proven: bool = Field(default=False, description="whether none of these can be left out")
    text: str = Field(default="", description="how the search ended")
    unneeded: tuple[str, ...] = Field(default=(), description="searched fields that were left alone in the end")
    controls: int = Field(default=0, description="runs with nominal inputs, for comparison")
    controls_failed: int = 0
    chance: int = Field(
        default=0, description="failing points that were not shown to fail more often than nominal inputs"
    )
    others: dict[str, int] = Field(default={}, description="runs with other failures, by signature")
    controls_others: dict[str, int] = Field(default={}, description="the same of runs with nominal inputs")
    replays_others: dict[str, int] = Field(default={}, description="the same of replays")
    played: bool = Field(default=False, description=PLAYED)

    @property
    def summary(self) -> str:
        """How the search ended, how often replays reproduced the failure, and in which region it occurs."""
        parts = [self.text]
        if self.replays:
            replays, messages = counted(self.replays, "replay"), counted(self.messages, "external message")
            nominal = f", {self.controls_failed} of {self.controls} with nominal inputs" if self.controls else ""
            parts.append(f"{self.replays_failed} of {replays} of {messages} fail{nominal}")
        if self.needed:
            shown = "" if self.needed_proven else ", perhaps fewer"
            parts.append(
                f"{counted(self.needed, 'external message')} {'is' if self.needed == 1 else 'are'} enough{shown}"
            )
        if self.chance:
            points = counted(self.chance, "other point" if self.found else "point")
            parts.append(f"it failed at {points}, but was not shown to fail more often there than with nominal inputs")
        again = (self.controls_others, "run", " with nominal inputs"), (self.replays_others, "replay", "")
        for others, what, where in ((self.others, "run", ""), *again):
            for signature, count in others.items():
                parts.append(f"{counted(count, what)}{where} failed otherwise: {signature}")
        if self.played:
            parts.append("the outside was played from the nominal log")
        if self.region is not None:
            parts.append(f"region {self.region.text or ' and '.join(self.region.bounds())}")
        return "; ".join(parts)

    @property
    def replay_rate(self) -> float | None:
        """Share of replays of the external messages alone that failed; None if there were none."""
        return self.replays_failed / self.replays if self.replays else None
