"""What the code of one end may do: open sessions, agree with the other end, and disturb the network."""

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

_PROBE_INTERVAL_S = 0.002

Session = Any
"""A zenoh.Session; its stubs leave much untyped."""


class ScenarioEnd:
    """One end of a scenario. It cannot know what lies between it and the other end.

    Both ends agree through their parent, never through the network: `signal` and `wait`.

    Args:
        name: Name of this end.
        prefix: What all keys start with.
        config: Zenoh configuration of its sessions.
        life: How often this end was killed before.
        lines: Where the parent's words come from, as JSON lines.
        say: Sends a word to the parent.
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
        """Change what sessions are opened with from now on; names as for `open`."""
        self._config |= {name.replace("__", "/"): value for name, value in settings.items()}

    def close(self) -> None:
        """Close all sessions."""
        release(*self._opened)

    def key(self, rest: str) -> str:
        """Return a key expression of this scenario."""
        return f"{self._prefix}/{rest}"

    def subscribe(self, rest: str, session: Session = None) -> Inbox:
        """Collect what is published."""
        inbox = Inbox()
        inbox.handle = (session or self.session).declare_subscriber(self.key(rest), inbox)
        return inbox

    # -- agreeing with the other end ----------------------------------------------------------------------------------

    def signal(self, name: str, value: Any = None) -> None:
        """Tell the other end something; signals of one name are kept in order until they are waited for."""
        self._say({"signal": name, "value": value})

    def wait(self, name: str, timeout: float = DEADLINE_S) -> Any:
        """Return the value of the other end's signal.

        Raises:
            TimeoutError: It did not come.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: self._signals[name], timeout):
                raise TimeoutError(f"{self.name}: no signal {name!r} within {timeout:g} s")
            return self._signals[name].popleft()

    def together(self, name: str) -> None:
        """Wait until both ends are here."""
        self.signal(name)
        self.wait(name)

    def meet(self, *sessions: Session) -> None:
        """Wait, as the other end does, until publications of each have reached the other.

        What either end declared before is then known where the other is connected, since declarations of one session
        keep their order. The probes have a verbatim chunk, so that no wildcard sees them.

        Args:
            sessions: Those that have declared something; by default the end's own.
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
        """Wait until a publisher or querier has somebody to talk to, or nobody.

        Raises:
            TimeoutError: That did not happen.
        """
        self.until(lambda: declared.matching_status.matching == matching, f"matching to be {matching}", timeout)

    def until(
        self, condition: Callable[[], bool], what: str, timeout: float = DEADLINE_S, interval: float = 0.001
    ) -> None:
        """Wait for a condition; `what` says for what, if it does not come: then TimeoutError is raised."""
        if not wait_until(condition, timeout, interval=interval):
            raise TimeoutError(f"{self.name}: waited {timeout:g} s for {what}")

    # -- disturbing ---------------------------------------------------------------------------------------------------

    def kill_other(self, *, again: bool) -> None:
        """Kill the other end's process at once, and start another in its place if wanted; return when that is done."""
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
