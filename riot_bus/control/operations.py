"""What can be done to a router while it runs, one thing at a time."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from riot_bus.control.status import plan_row

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.control.recordings import Recordings
    from riot_bus.router.interception import Interception

__all__ = ["Operations"]


class Operations:
    """Changes to a running router; may be called by several threads.

    Args:
        interception: What is intercepted.
        recordings: The recording.
        seed: Seed of plans that are loaded.
    """

    def __init__(self, interception: Interception, recordings: Recordings, *, seed: int) -> None:
        self._interception = interception
        self._recordings = recordings
        self._seed = seed
        self._changing = threading.RLock()

    @property
    def topics(self) -> list[str]:
        """What is intercepted, as it was written."""
        return self._interception.topics

    def intercept_add(self, keys: Sequence[str]) -> list[str]:
        """Intercept more keys; ROS names such as `/odom` will do.

        Natively routed messages are interrupted for about 100 ms; no intercepted ones are lost.

        Args:
            keys: Key expressions or names.

        Returns:
            The key expressions that are intercepted now.

        Raises:
            ConfigError: One of them is not usable; then nothing has changed.
        """
        with self._changing:
            return self._interception.add(keys)

    def intercept_remove(self, keys: Sequence[str]) -> list[str]:
        """Intercept fewer keys, as `intercept_add`; raises ConfigError if one is not intercepted or a plan needs it."""
        with self._changing:
            return self._interception.remove(keys)

    def plan_load(self, text: str, name: str) -> dict[str, Any]:
        """Carry out an injection plan from now on instead of the present one, and intercept its topics.

        Args:
            text: The plan as TOML text.
            name: Name of the plan, such as that of its file.

        Raises:
            ConfigError: It is not a plan; then nothing has changed.
        """
        from riot_bus.inject.injection_plan import (
            InjectionPlan,  # loads pydantic
        )

        plan = InjectionPlan.parse(text, name, seed=self._seed)
        with self._changing:
            return {"intercepted": self._interception.set_plan(plan), "plan": plan_row(plan)}

    def plan_clear(self) -> dict[str, Any]:
        """Stop carrying out the plan, and intercepting what was intercepted for it alone."""
        with self._changing:
            former = plan_row(self._interception.plan)
            return {"intercepted": self._interception.set_plan(None), "plan": None, "former": former}

    def record_start(self, path: str | None = None) -> dict[str, Any]:
        """Record all that passes from now on.

        Args:
            path: Path relative to the folder of recordings; None for a name with the present time.

        Raises:
            ConfigError: It records already, or the path leads elsewhere or exists.
        """
        with self._changing:
            return {"file": str(self._recordings.start(path))}

    def record_stop(self) -> dict[str, Any]:
        """End the recording and return its figures; raises ConfigError if there is none."""
        with self._changing:
            return self._recordings.stop()[1]

    def record_split(self, path: str | None = None) -> dict[str, Any]:
        """Continue recording in another file, without losing or repeating a message; `path` as for `record_start`."""
        with self._changing:
            former, present = self._recordings.split(path)
            return {"former": str(former), "file": str(present)}
