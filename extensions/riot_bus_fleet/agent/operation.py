"""The current operation of an agent, on a thread of its own."""

from __future__ import annotations

import logging
import threading
import time
from abc import ABC, abstractmethod
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError
from riot_bus.zenoh.session import reason

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus_fleet.agent.request import Lead

_LOG = logging.getLogger(__name__)
_LOOK_S = 0.1  # so late a full disk is seen: meanwhile 1 GB/s fill a fifth of the 512 MiB kept free
_MOST_WARNINGS = 20
_LONGEST = 500
"""All warnings are in the status, published twice a second: at most 10,000 characters."""

FINAL = ("ended", "stopped", "failed")
"""The states in which an operation is over and holds no resources."""


class OperationService(Protocol):
    """What an operation runs: a player or a recorder."""

    def start(self) -> None:
        """Begin; return without waiting for the end."""

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end; return whether it has ended."""

    def pause(self) -> None:
        """Pause."""

    def resume(self) -> None:
        """Resume."""

    def stop(self) -> None:
        """End as soon as possible; does not wait for it."""

    def close(self) -> None:
        """Stop and release all resources; safe to call twice."""


ServiceT = TypeVar("ServiceT", bound=OperationService)


class Operation(ABC, Generic[ServiceT]):
    """A play or recording, which begins with `start` and ends by itself, by `stop`, or by a failure.

    Args:
        lead: Controller that asked for it, and what to do if it is lost.
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
        self._lock = threading.Lock()
        self._service: ServiceT | None = None  # while it runs
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
        """End as soon as possible; does not wait for it."""
        if not self._stopping.is_set():
            self.reason = reason[:_LONGEST]
            self._stopping.set()
            with self._lock:
                if self._service is not None:
                    self._service.stop()
            self.changed()

    def pause(self) -> None:
        """Pause."""
        self._running().pause()
        self.changed()

    def resume(self) -> None:
        """Resume."""
        self._running().resume()
        self.changed()

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
    def _open(self, stack: ExitStack) -> ServiceT:
        """Return the service, not yet started; what has to end after it is pushed onto the stack."""

    @abstractmethod
    def _row(self, service: ServiceT) -> dict[str, Any]:
        """Return the details of a service for the status, with its state."""

    @abstractmethod
    def _result(self, service: ServiceT) -> dict[str, Any]:
        """Return the result of a service as JSON values of limited length."""

    def _look(self) -> None:
        """Check the surroundings; called often while the service runs."""

    def _work(self) -> dict[str, Any]:
        """Run the operation to its end; return its final details."""
        with ExitStack() as stack:
            service = self._open(stack)
            stack.callback(service.close)
            if self._stopping.is_set():
                return self._last
            service.start()
            with self._lock:
                self._service = service
            if self._stopping.is_set():
                service.stop()
            self.changed()
            while not service.wait(_LOOK_S):
                self._look()
            with self._lock:
                self._last, self._service = self._row(service), None
            return {**self._last, "result": self._result(service)}

    def _details(self) -> dict[str, Any] | None:
        """Return the current details; None before it has begun and once it is being closed."""
        with self._lock:
            return None if self._service is None else self._row(self._service)

    def _running(self) -> ServiceT:
        with self._lock:
            if self._service is None or self._stopping.is_set():
                text = f"the {self.kind} has not begun yet, or has ended"
                raise EnvironmentFaultError(text, hint="riot fleet status ROBOT")
            return self._service

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
        return ConfigError(f"a {self.kind} has no command {what!r}")
