"""Recording of what is routed natively, observed on a thread of its own for each key expression."""

from __future__ import annotations

import logging
import threading
from functools import partial
from typing import TYPE_CHECKING

from riot_bus.zenoh.batches import Batches
from riot_bus.zenoh.convert import Claims, Converter
from riot_bus.zenoh.session import canonical, includes, release

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.router.delivery_queue import DeliveryQueue
    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.network import Network

_LOG = logging.getLogger(__name__)


class Taps:
    """The taps by which a recorder gets what is not intercepted; forwarders record what is."""

    def __init__(self, network: Network, deliveries: DeliveryQueue, record: Sequence[str]) -> None:
        self._network, self._deliveries = network, deliveries
        self._record = Claims(canonical(record))
        self._taps: list[Tap] = []

    def record(self, expressions: Sequence[str]) -> None:
        """Record these key expressions from now on."""
        self._record = Claims(canonical(expressions))
        self.renew()

    def renew(self) -> None:
        """Observe anew, since the junction, the recorder or what is intercepted has changed."""
        self.close()  # harmless for the taps of a former junction, which have already ended
        present, junction = self._deliveries.surroundings, self._network.junction
        if present.recorder is None:
            return
        if junction is not None and junction.session is not None:
            # The junction sees every message that is not intercepted once, whichever segment it comes from.
            session, segment = junction.session, ""
        else:
            segment, session = next(iter(self._network.sessions.items()))
        converter = Converter(segment, self._deliveries.access.sequence)
        self._taps = [
            Tap(session, expression, take=partial(self._take, expression), convert=converter)
            for expression in self._record.expressions
            # A tap on what is intercepted would look like a subscriber in each segment.
            if not any(includes(each, expression) for each in present.claims.expressions)
        ]

    def idle(self) -> bool:
        """Return whether no message is in process."""
        return all(each.idle() for each in self._taps)

    def close(self) -> None:
        """Process the messages received so far, then end; safe to call twice."""
        release(*self._taps)
        self._taps = []

    def _take(self, expression: str, message: Message) -> None:
        present = self._deliveries.surroundings
        mine = self._record.owner(message.key) == expression
        if present.recorder is not None and mine and present.claims.owner(message.key) is None:
            present.recorder.delivered(message)


class Tap:
    """Observes messages; delays nothing beyond the time that `take` needs."""

    def __init__(
        self, session: zenoh.Session, expression: str, *, take: Callable[[Message], None], convert: Converter
    ) -> None:
        self.caught_up = False
        """Whether all samples received so far were taken."""
        self._take, self._convert = take, convert
        self._batches = Batches(session, expression)
        self._thread = threading.Thread(target=self._run, name="riot-tap", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Process the messages received so far, then end; safe to call twice."""
        self._batches.close()
        self._thread.join()

    def idle(self) -> bool:
        """Return whether no message is in process."""
        return self.caught_up or not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            self.caught_up = True
            samples = self._batches.receive()
            self.caught_up = False
            if not samples:
                return
            for sample in samples:
                try:
                    self._take(self._convert(sample))
                except Exception:
                    _LOG.exception("a message of %s was not observed", sample.key_expr)
