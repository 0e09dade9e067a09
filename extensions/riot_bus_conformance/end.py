"""One end of a scenario: opens sessions, publishes and asks, synchronises with the other end, disturbs the network."""

from __future__ import annotations

import json
import threading
from abc import ABC, abstractmethod
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from typing import Any, Literal, TextIO, TypeVar

from riot_bus.zenoh import api as zenoh
from riot_bus.zenoh.session import open_session, release, wait_until
from riot_bus_conformance.samples import END, Inbox, show_replies

DeclaredT = TypeVar("DeclaredT")

EndName = Literal["left", "right"]
DEADLINE_S = 60.0
"""Longest wait for anything that must happen."""

_HEARTBEAT_S = 0.05  # shows a loss at once, compared with the 2 s that scenarios wait for it

BLOCK = zenoh.CongestionControl.BLOCK
"""Congestion control of messages that must not be dropped."""

Session = Any
"""A zenoh.Session; its stubs leave much untyped."""

Observation = Any
"""What an end saw, as JSON."""


class ScenarioEnd(ABC):
    """One end of a scenario: a subclass has the code of both ends. It cannot know what lies between them.

    Both ends synchronise through their parent, never through the network: `signal` and `wait`. What an end has declared
    through these methods stays declared until both ends have returned.

    Args:
        life: Number of times that this end was killed before.
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
        self._kept: list[Any] = []
        self._signals: defaultdict[str, deque[Any]] = defaultdict(deque)
        self._changed = threading.Condition()
        threading.Thread(target=self._listen, args=(lines,), daemon=True).start()

    @abstractmethod
    def left(self) -> Observation:
        """Play the end that mostly publishes and asks; return what it saw."""

    @abstractmethod
    def right(self) -> Observation:
        """Play the end that mostly subscribes and answers; return what it saw."""

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

    def keep(self, declared: DeclaredT) -> DeclaredT:
        """Keep an entity declared until both ends have returned."""
        self._kept.append(declared)
        return declared

    # -- publishing, subscribing, asking ------------------------------------------------------------------------------

    def put(self, rest: str, payload: bytes | str, **options: Any) -> None:
        """Publish a message that must not be dropped."""
        self.session.put(self.key(rest), payload, congestion_control=BLOCK, **options)

    def finish(self, rest: str = "end") -> None:
        """Publish the closing message."""
        self.put(rest, END)

    def publisher(self, rest: str, session: Session = None, **options: Any) -> Any:
        """Declare a publisher whose messages must not be dropped, unless the options say otherwise."""
        return self.keep(
            (session or self.session).declare_publisher(self.key(rest), **{"congestion_control": BLOCK, **options})
        )

    def subscribe(self, rest: str, session: Session = None) -> Inbox:
        """Subscribe to a key expression of this scenario, and collect what is published."""
        inbox = Inbox()
        inbox.handle = self.keep((session or self.session).declare_subscriber(self.key(rest), inbox))
        return inbox

    def everything(self) -> Observation:
        """Subscribe to all keys of the scenario and return what comes before the closing message."""
        inbox = self.subscribe("**")
        self.meet()
        return inbox.shown()

    def tokens(self, rest: str, *, history: bool = False) -> Inbox:
        """Subscribe to liveliness tokens, and collect their appearances and disappearances."""
        inbox = Inbox()
        inbox.handle = self.keep(
            self.session.liveliness().declare_subscriber(self.key(rest), inbox, history=history),
        )
        return inbox

    def token(self, rest: str) -> Any:
        """Declare a liveliness token."""
        return self.keep(self.session.liveliness().declare_token(self.key(rest)))

    def ask(self, rest: str, **options: Any) -> list[dict[str, Any]]:
        """Send a query and return the visible parts of its replies."""
        return show_replies(self.session.get(self.key(rest), **{"timeout": 5.0, **options}))  # generous

    def answer(
        self, rest: str, reply: Callable[[Any], None], session: Session = None, *, complete: bool = False
    ) -> Any:
        """Declare a queryable that ends each query after `reply`."""

        def called(query: Any) -> None:
            with query:
                reply(query)

        return self.keep((session or self.session).declare_queryable(self.key(rest), called, complete=complete))

    def advanced_publisher(self, rest: str, session: Session = None, *, cache: int | None = 10) -> Any:
        """Declare an advanced publisher with heartbeats."""
        return self.keep(
            zenoh.ext.declare_advanced_publisher(
                session or self.session,
                self.key(rest),
                congestion_control=BLOCK,
                cache=None if cache is None else zenoh.ext.CacheConfig(cache),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=_HEARTBEAT_S, sporadic_heartbeat=None),
                publisher_detection=True,
            )
        )

    def advanced_subscriber(self, rest: str, *, history: int | None = None, recovery: bool = False) -> Inbox:
        """Declare an advanced subscriber."""
        ext, inbox = zenoh.ext, Inbox()
        inbox.handle = self.keep(
            ext.declare_advanced_subscriber(
                self.session,
                self.key(rest),
                inbox,
                history=None
                if history is None
                else ext.HistoryConfig(detect_late_publishers=True, max_samples=history),
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True) if recovery else None,
                subscriber_detection=True,
            )
        )
        return inbox

    # -- agreeing with the other end ----------------------------------------------------------------------------------

    def signal(self, name: str, value: Any = None) -> None:
        """Send a signal to the other end; signals of one name are queued in order until `wait` takes them."""
        self._say({"signal": name, "value": value})

    def wait(self, name: str, timeout: float = DEADLINE_S) -> Any:
        """Return the value of the other end's signal; raise TimeoutError if it does not come in time."""
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

        self.until(met, "the other end", interval=0.002)  # each look publishes a message per session
        self.wait("met")
        release(*probes)

    def matched(self, declared: Any, *, matching: bool = True, timeout: float = DEADLINE_S) -> None:
        """Wait until a publisher or querier has a matching counterpart, or none; raise TimeoutError if it never has."""
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
