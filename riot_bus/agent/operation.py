"""The current operation of an agent, on a thread of its own."""

from __future__ import annotations

import logging
import threading
import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError
from riot_bus.zenoh.session import reason

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.agent.request import Lead

__all__ = ["FINAL", "Operation"]

_LOG = logging.getLogger(__name__)
_MOST_WARNINGS = 20
_LONGEST = 500
"""All warnings are in the status, published twice a second: at most 10,000 characters."""

FINAL = ("ended", "stopped", "failed")
"""The states in which an operation is over and holds no resources."""


class Operation(ABC):
    """A play or recording, which begins with `start` and ends by itself, by `stop`, or by a failure.

    Args:
        lead: Controller that asked for it, and what to do if it is lost.
        changed: Called whenever the status changes.
    """

    kind: str

    def __init__(self, lead: Lead, changed: Callable[[], None]) -> None:
        self.lead = lead
        self.changed = changed
        self.reason = ""
        self.warnings: list[str] = []
        self._began = time.time()
        self._stopping = threading.Event()
        self._done = threading.Event()
        self._problem: dict[str, Any] | None = None
        self._last: dict[str, Any] = {}  # the last known details
        self._thread = threading.Thread(target=self._run, name=f"riot-agent-{self.kind}", daemon=True)

    def start(self) -> None:
        """Begin; returns at once."""
        self._thread.start()

    def wait(self, timeout: float) -> bool:
        """Wait for the end; return whether it has ended."""
        return self._done.wait(timeout)

    @property
    def active(self) -> bool:
        """Whether it has not ended."""
        return not self._done.is_set()

    def stop(self, reason: str) -> None:
        """End as soon as possible; does not wait for it.

        Args:
            reason: Reason, as a text for people.
        """
        if not self._stopping.is_set():
            self.reason = reason[:_LONGEST]
            self._stopping.set()
            self._stop()
            self.changed()

    def pause(self) -> None:
        """Pause."""
        raise self._cannot("pause")

    def resume(self) -> None:
        """Resume."""
        raise self._cannot("resume")

    def seek(self, seconds: float) -> None:
        """Continue at a time in seconds from the beginning of what is played."""
        raise self._cannot("seek")

    def set_rate(self, rate: float) -> None:
        """Continue at another speed."""
        raise self._cannot("rate")

    def status(self) -> dict[str, Any]:
        """Return the status, as JSON values."""
        details = self._last if self._done.is_set() else self._details() or self._last
        return {
            "id": self.lead.operation,
            "kind": self.kind,
            "who": self.lead.who,
            "since": self._began,
            "on_lost_controller": self.lead.on_lost_controller,
            "grace": self.lead.grace,
            "reason": self.reason,
            "problem": self._problem,
            "warnings": list(self.warnings),
            **details,
            "state": self._state(details),
        }

    def warn(self, line: str) -> None:
        """Note a warning for the status."""
        if len(self.warnings) < _MOST_WARNINGS:
            self.warnings.append(line[:_LONGEST])
        self.changed()

    @abstractmethod
    def _work(self) -> dict[str, Any]:
        """Run the operation to its end; return its final details."""

    @abstractmethod
    def _stop(self) -> None:
        """Make `_work` return soon; may be called at any time."""

    @abstractmethod
    def _details(self) -> dict[str, Any] | None:
        """Return the current details with their own state; None before it has begun and once it is being closed."""

    def _state(self, details: dict[str, Any]) -> str:
        if self._done.is_set():
            return "failed" if self._problem is not None else "stopped" if self._stopping.is_set() else "ended"
        state = str(details.get("state", "starting"))
        return "stopping" if self._stopping.is_set() or state in FINAL else state  # the result is still to come

    def _run(self) -> None:
        from riot_bus.zenoh import api as zenoh

        try:
            self._last = self._work()
        except RiotError as error:
            self._fail(error.message, error.where, error.hint, error.exit_code)
        except zenoh.ZError as error:
            hint = "does the router of the robot's bus still answer?"
            self._fail(f"Zenoh failed: {reason(error)}", None, hint, EnvironmentFaultError.exit_code)
        except Exception as error:
            _LOG.exception("the operation failed")
            self._fail(f"failure of ours: {error!r}", None, None, 1)
        finally:
            self._done.set()
            self.changed()

    def _fail(self, message: str, where: str | None, hint: str | None, code: int) -> None:
        texts = {"message": message, "where": where, "hint": hint}
        self._problem = {
            **{name: text[: _LONGEST * 4] if text else None for name, text in texts.items()},
            "exit_code": code,
        }

    def _cannot(self, what: str) -> RiotError:
        return ConfigError(f"a {self.kind} knows no {what}")

    def _not_begun(self) -> RiotError:
        return EnvironmentFaultError(f"the {self.kind} has not begun yet, or has ended", hint="riot fleet status ROBOT")
