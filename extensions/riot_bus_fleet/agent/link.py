"""The link of an agent to its fleet: opened as soon as the router answers, then restored by Zenoh after every break."""

from __future__ import annotations

import hmac
import logging
import threading
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Any

from riot_bus.control.server import Control
from riot_bus.vocabulary.errors import EnvironmentFaultError, RiotError
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.session import open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import client_config
from riot_bus_fleet.agent.names import UNDER, agent_token, controller_key, progress_key
from riot_bus_fleet.agent.proof import new_secret, prove

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.control.commands import Command
    from riot_bus.zenoh import api as zenoh

_LOG = logging.getLogger(__name__)
_ASK_S = 1.0  # with `_WATCH_S`, the default grace of 10 s holds six unanswered questions


class FleetLink:
    """Connection that announces an agent, receives its commands and publishes its progress."""

    def __init__(
        self,
        service: Any,
        commands: Mapping[str, Command],
        robot: str,
        endpoint: str,
        config: Mapping[str, Any],
        *,
        say: Callable[[str], None],
        failed: Callable[[RiotError], None],
    ) -> None:
        self._service, self._commands = service, commands
        self._robot, self._endpoint, self._config = robot, endpoint, config
        self._say, self._failed = say, failed
        self._closing = threading.Event()
        self._stack = ExitStack()
        self._session: zenoh.Session | None = None
        self._publisher: Any = None
        self._thread = threading.Thread(target=self._run, name="riot-agent-link", daemon=True)

    def start(self) -> None:
        """Begin to connect."""
        prepare_runtime()
        self._thread.start()

    def close(self) -> None:
        """Disconnect; safe to call twice."""
        from riot_bus.zenoh import api as zenoh

        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(15.0)  # opening a link takes up to 10 s (Zenoh's open_timeout)
        with suppress(zenoh.ZError):  # the link may hang
            self._stack.close()

    def publish(self, payload: bytes) -> None:
        """Publish the progress; it is lost while there is no link."""
        publisher = self._publisher
        if publisher is not None and not self._closing.is_set():
            publisher.put(payload, encoding="application/json")

    def sees(self, operation: str, secret: str) -> bool:
        """Return whether a controller proves now, by its secret, that it is present; False if the link hangs."""
        from riot_bus.zenoh import api as zenoh

        session = self._session
        if session is None:
            return False
        nonce = new_secret()
        wanted = prove(secret, "controller", nonce).encode()
        key = controller_key(self._robot, operation)
        every, now = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
        replies = session.get(key, payload=nonce, timeout=_ASK_S, target=every, consolidation=now)
        found = (reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None)
        return any(hmac.compare_digest(each, wanted) for each in found)

    def others(self) -> int:
        """Return how many other agents have this name; raises EnvironmentFaultError while not connected."""
        session = self._session
        if session is None:
            raise EnvironmentFaultError("this agent is still connecting", where=self._robot, hint="ask again")
        own = agent_token(self._robot, str(session.info.zid()))
        found = session.liveliness().get(agent_token(self._robot, "*"), timeout=_ASK_S)
        return len({str(reply.ok.key_expr) for reply in found if reply.ok is not None} - {own})

    def _run(self) -> None:
        told = False
        while not self._closing.is_set():
            try:
                self._open()
            except EnvironmentFaultError as error:
                if not told:
                    self._say(f"waiting for the fleet router: {error.message}")
                    told = True
                self._closing.wait(1.0)  # a try costs one connection
            except RiotError as error:
                self._failed(error)
                return
            except Exception as error:
                _LOG.exception("the link to the fleet failed")
                self._failed(EnvironmentFaultError(f"the link to the fleet failed: {error!r}", where=self._endpoint))
                return
            else:
                self._say(f"connected to the fleet router at {redacted(self._endpoint)}")
                return

    def _open(self) -> None:
        from riot_bus.zenoh import api as zenoh

        with ExitStack() as stack:
            session = open_session(client_config(self._endpoint, extra=self._config), purpose="fleet")
            stack.callback(release, session)
            zid = str(session.info.zid())
            publisher: Any = session.declare_publisher(
                progress_key(self._robot), congestion_control=zenoh.CongestionControl.DROP
            )
            self._session, self._publisher = session, publisher  # before the first command comes
            commands = Control(self._service, self._robot, {"": session}, commands=self._commands, under=UNDER)
            stack.enter_context(commands)
            events: Any = session.info.declare_transport_events_listener(self._event)
            stack.callback(release, events)
            token: Any = session.liveliness().declare_token(agent_token(self._robot, zid))
            stack.callback(release, token)
            if self.others():
                self._say(f"warning: another agent is called {self._robot!r} too; neither will play or record")
            self._stack = stack.pop_all()

    def _event(self, event: zenoh.TransportEvent) -> None:
        from riot_bus.zenoh import api as zenoh

        if not self._closing.is_set():
            back = event.kind == zenoh.SampleKind.PUT
            self._say(f"the link to the fleet router {'is back' if back else 'broke; trying to connect again'}")
