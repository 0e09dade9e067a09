"""Observes the natively routed messages of one key expression, on a thread of its own."""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

from riot_bus.zenoh.batches import Batches

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.convert import Converter

_LOG = logging.getLogger(__name__)


class Tap:
    """Observes messages; delays nothing beyond the time that `take` needs.

    Args:
        session: Session that observes.
        expression: Key expression of the messages.
        take: Function called with each message, on the thread of this tap.
        convert: Converter of samples to messages.
    """

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
