"""Recognition of frames that arrive over several links."""

from __future__ import annotations

from collections import OrderedDict

__all__ = ["Duplicates"]

_MOST = 1 << 16  # attackers may send any number: bounds memory at 18 MB of frames (280 bytes each)


class Duplicates:
    """Recognises frames, byte for byte, that were seen within a period.

    Each repetition restarts the period, as in mavlink-router. Since a frame contains its sequence number, its bytes
    recur after 256 frames of its source at the earliest, unless the source keeps sending one and the same frame.

    Args:
        period: Length of the period in seconds.
        most: Maximum number of remembered frames; beyond it, the oldest are forgotten.
    """

    def __init__(self, period: float, *, most: int = _MOST) -> None:
        self._period, self._most = period, most
        self._last: OrderedDict[bytes, float] = OrderedDict()

    def seen(self, raw: bytes, now: float) -> bool:
        """Return whether a frame was seen within the period; remember it.

        Args:
            raw: The whole frame.
            now: Time of a monotonic clock in seconds.
        """
        last = self._last
        while last:
            oldest = next(iter(last))
            if now - last[oldest] < self._period and len(last) <= self._most:
                break
            del last[oldest]
        known = raw in last
        last[raw] = now
        last.move_to_end(raw)
        return known
