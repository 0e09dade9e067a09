"""Calibration of the compasses, which takes some seconds and is reported as it goes on."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator

    from pymavlink.dialects.v20.ardupilotmega import MAVLink_message as Message

COMPASSES = 2
SECONDS, PERIOD = 2.0, 0.5


class Calibration:
    """A calibration that may be going on."""

    def __init__(self) -> None:
        self._begun: float | None = None
        self._due = 0.0

    def start(self, now: float) -> None:
        """Begin, unless it is going on."""
        if self._begun is None:
            self._begun = self._due = now

    def cancel(self) -> None:
        """Stop it."""
        self._begun = None

    def tick(self, now: float) -> Iterator[Message]:
        """Yield how far it is, and in the end how good it is, for each compass."""
        if self._begun is None or now < self._due:
            return
        self._due += PERIOD
        done = min(1.0, (now - self._begun) / SECONDS)
        for compass in range(COMPASSES):
            yield mavlink.MAVLink_mag_cal_progress_message(
                compass, 3, mavlink.MAG_CAL_RUNNING_STEP_ONE, 1, round(100 * done), [0] * 10, 0.1, 0.2, 0.9
            )
        if done < 1:
            return
        self._begun = None
        for compass in range(COMPASSES):
            offsets, diagonal, off = [12.0, -30.5, 8.25], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]
            yield mavlink.MAVLink_mag_cal_report_message(
                compass, 3, mavlink.MAG_CAL_SUCCESS, 0, 5.2, *offsets, *diagonal, *off
            )
