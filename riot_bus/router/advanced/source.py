"""The publisher of a sample, and the sample's place in order."""

from __future__ import annotations

from typing import Any, NamedTuple

UNNUMBERED = "uhlc"
"""Entity of a publisher that stamps its samples instead of numbering them, as zenoh-ext names it."""

_BETWEEN = "/@adv/pub/"


class AdvancedSource(NamedTuple):
    """An advanced publisher of a component; `entity` is `uhlc` if it does not number its samples."""

    segment: str
    key: str
    zid: str
    entity: str

    @property
    def numbered(self) -> bool:
        """Whether its samples have numbers without gaps."""
        return self.entity != UNNUMBERED


def source_of(segment: str, sample: Any) -> tuple[AdvancedSource, int] | None:
    """Return the publisher of a sample, and its place in order; None if the sample does not tell."""
    info, stamp, key = sample.source_info, sample.timestamp, str(sample.key_expr)
    if info is not None:
        return AdvancedSource(segment, key, str(info.source_id.zid), str(info.source_id.eid)), info.source_sn
    if stamp is not None:
        return AdvancedSource(segment, key, str(stamp.get_id()), UNNUMBERED), stamp.get_time_as_ntp64().as_nanos()
    return None


def announced(segment: str, token: str) -> AdvancedSource | None:
    """Return the publisher that a key names, which is the key of a token or a heartbeat.

    Args:
        segment: Segment where it was seen.
        token: Key such as `KEY/@adv/pub/ZID/ENTITY/META`; other forms, and publishers on wildcards, give None.
    """
    key, between, rest = token.rpartition(_BETWEEN)
    chunks = rest.split("/")
    if not between or len(chunks) < 2 or "*" in key:
        return None
    return AdvancedSource(segment, key, chunks[0], chunks[1])
