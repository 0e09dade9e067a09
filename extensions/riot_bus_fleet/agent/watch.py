"""Whether a controller is still there, and what to do when it is not; pure, the time comes from outside."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from riot_bus_fleet.agent.request import Policy

Action = Literal["pause", "resume", "stop"]


class ControllerWatch:
    """Decides what to do when a controller is lost and when it returns.

    A controller is lost when it was not seen for the grace time; then the action of the policy is taken, once. A paused
    operation is resumed when the controller is back; a stop is final.
    """

    def __init__(self, policy: Policy, grace: float, now: float) -> None:
        self.policy = policy
        self._grace = grace
        self._seen = now
        self._lost = False

    def look(self, now: float, *, present: bool) -> Action | None:
        """Note whether the controller is present; return what to do now."""
        if present:
            back, self._seen, self._lost = self._lost, now, False
            return "resume" if back and self.policy == "pause" else None
        if self._lost or now - self._seen < self._grace:
            return None
        self._lost = True
        return None if self.policy == "continue" else self.policy

    def away(self, now: float) -> float:
        """Return for how many seconds it has not been seen."""
        return max(0.0, now - self._seen)
