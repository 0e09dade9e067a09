"""Operations of one end: open sessions, synchronise with the other end, and disturb the network."""

from __future__ import annotations

import json
import threading
from collections import defaultdict, deque
from typing import TYPE_CHECKING, Any, Literal

from riot_bus.doctor.conformance.samples import Inbox
from riot_bus.zenoh.session import open_session, release, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import TextIO

__all__ = ["DEADLINE_S", "EndName", "ScenarioEnd", "Session"]

EndName = Literal["left", "right"]
DEADLINE_S = 60.0
"""Longest wait for anything that must happen."""

_PROBE_INTERVAL_S = 0.002  # each look publishes a message per session: at most 500 a second

Session = Any
"""A zenoh.Session; its stubs leave much untyped."""


class ScenarioEnd:
    """One end of a scenario. It cannot know what lies between it and the other end.

    Both ends synchronise through their parent, never through the network: `signal` and `wait`.

    Args:
        name: Name of this end.
        prefix: Common prefix of all keys.
        config: Zenoh configuration of its sessions.
        life: How often this end was killed before.
        lines: Stream of messages from the parent, as JSON lines.
        say: Sends a message to the parent.
    """

    def __init__(
        self,
        name: EndName,
        prefix: str,
        config: Mapping[str, Any],
        *,
        life: int,
        lines: TextIO,
        say: Callable[[dict[str, Any]], None],
    ) -> None:
        self.name = name
        self.life = life
        self._prefix = prefix
        self._config = dict(config)
        self._say = say
        self._session: Session = None
        self._opened: list[Session] = []
        self._signals: defaultdict[str, deque[Any]] = defaultdict(deque)
        self._changed = threading.Condition()
        threading.Thread(target=self._listen, args=(lines,), daemon=True).start()

    # -- sessions -----------------------------------------------------------------------------------------------------

    @property
    def session(self) -> Session:
        """The end's own session, opened when it is first asked for."""
        if self._session is None:
            self._session = self.open()
        return self._session

    def open(self, **settings: Any) -> Session:
        """Open a further session; `__` in the name of a setting stands for `/`."""
        extra = {name.replace("__", "/"): value for name, value in settings.items()}
        session = open_session({**self._config, **extra}, purpose=f"the {self.name} end")
        self._opened.append(session)
        return session

    def configure(self, **settings: Any) -> None:
        """Change the configuration of sessions opened from now on; names as for `open`."""
        self._config |= {name.replace("__", "/"): value for name, value in settings.items()}

    def close(self) -> None:
        """Close all sessions."""
        release(*self._opened)

    def key(self, rest: str) -> str:
        """Return a key expression of this scenario."""
        return f"{self._prefix}/{rest}"

    def subscribe(self, rest: str, session: Session = None) -> Inbox:
        """Subscribe to a key expression of this scenario, and collect what is published."""
        inbox = Inbox()
        inbox.handle = (session or self.session).declare_subscriber(self.key(rest), inbox)
        return inbox

    # -- agreeing with the other end ----------------------------------------------------------------------------------

    def signal(self, name: str, value: Any = None) -> None:
        """Send a signal to the other end; signals of one name are queued in order until `wait` takes them."""
        self._say({"signal": name, "value": value})

    def wait(self, name: str, timeout: float = DEADLINE_S) -> Any:
        """Return the value of the other end's signal.

        Raises:
            TimeoutError: The signal did not come in time.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: self._signals[name], timeout):
                raise TimeoutError(f"{self.name}: no signal {name!r} within {timeout:g} s")
            return self._signals[name].popleft()

    def together(self, name: str) -> None:
        """Wait until both ends have called this with the same name."""
        self.signal(name)
        self.wait(name)

    def meet(self, *sessions: Session) -> None:
        """Wait until publications of each end have reached the other; both ends must call this.

        Earlier declarations of either end are then known where the other is connected, since declarations of one
        session keep their order. The keys of the probes have a verbatim chunk, so that no wildcard matches them.

        Args:
            sessions: Sessions that have declared something; by default the end's own.
        """
        sessions = sessions or (self.session,)
        other = "right" if self.name == "left" else "left"
        missing = set(range(len(sessions)))
        probes = [
            session.declare_subscriber(self.key(f"@meet/{self.name}"), lambda _, number=number: missing.discard(number))
            for number, session in enumerate(sessions)
        ]
        told = False

        def met() -> bool:
            nonlocal told
            for session in sessions:
                session.put(self.key(f"@meet/{other}"), b"")
            if not missing and not told:
                self.signal("met")
                told = True
            return told and bool(self._signals["met"])

        self.until(met, "the other end", interval=_PROBE_INTERVAL_S)
        self.wait("met")
        release(*probes)

    def matched(self, declared: Any, *, matching: bool = True, timeout: float = DEADLINE_S) -> None:
        """Wait until a publisher or querier has a matching counterpart, or none.

        Raises:
            TimeoutError: The expected matching status was not reached in time.
        """
        self.until(lambda: declared.matching_status.matching == matching, f"matching to be {matching}", timeout)

    def until(
        self, condition: Callable[[], bool], what: str, timeout: float = DEADLINE_S, interval: float = 0.001
    ) -> None:
        """Wait for a condition; if it does not come true, raise a TimeoutError that names `what`."""
        if not wait_until(condition, timeout, interval=interval):
            raise TimeoutError(f"{self.name}: waited {timeout:g} s for {what}")

    # -- disturbing ---------------------------------------------------------------------------------------------------

    def kill_other(self, *, again: bool) -> None:
        """Kill the other end's process at once, start a new one if `again` is set, and return when that is done."""
        self._say({"ask": "kill", "again": again})
        self.wait("!kill")

    def restart_router(self) -> None:
        """Close the network between the ends and open it again at the same endpoints; return when it is back."""
        self._say({"ask": "restart"})
        self.wait("!restart", 2 * DEADLINE_S)

    def _listen(self, lines: TextIO) -> None:
        for line in lines:
            word = json.loads(line)
            with self._changed:
                self._signals[word["signal"]].append(word.get("value"))
                self._changed.notify_all()
