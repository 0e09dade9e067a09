"""All intercepted services of a bus."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import TYPE_CHECKING

from riot_bus.router.services.forwarder import CallForwarder
from riot_bus.router.services.presence import Presence
from riot_bus.router.services.selection import is_served, with_spaces
from riot_bus.router.worker import Worker
from riot_bus.zenoh.convert import Claims

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.router.delivery_queue import DeliveryQueue


class Services:
    """Stands in for the selected services of each segment in the others, which the junction keeps apart.

    Args:
        spaces: Key expressions of complete services (`HasServices.services`).
    """

    def __init__(self, deliveries: DeliveryQueue, *, spaces: Sequence[str] = ()) -> None:
        self._deliveries, self._sessions, self._spaces = deliveries, deliveries.access.sessions, spaces
        self._claims = Claims([])
        self._present: dict[str, tuple[Presence, list[CallForwarder]]] = {}
        self._retired: list[CallForwarder] = []
        self._worker = Worker("riot-services")

    def retire(self, expressions: Sequence[str]) -> None:
        """Stop standing in for all others than these; call this while the junction still keeps them apart.

        Open calls continue.
        """
        wanted = with_spaces(expressions, self._spaces)
        for expression in [text for text in self._present if text not in wanted]:
            presence, forwarders = self._present.pop(expression)
            presence.close()
            for forwarder in forwarders:
                forwarder.retire()
            self._retired += forwarders

    def select(self, expressions: Sequence[str]) -> None:
        """Stand in for these services; call this once the junction keeps them apart."""
        wanted = with_spaces(expressions, self._spaces)
        self._claims = Claims(wanted)
        for expression in wanted:
            if expression not in self._present:
                self._begin(expression)

    def _begin(self, expression: str) -> None:
        served = is_served(expression, self._spaces)
        forwarders: dict[str, CallForwarder] = {}
        presence = Presence(
            expression,
            self._sessions,
            {name: (lambda query, name=name: forwarders[name].take(query)) for name in self._sessions},  # type: ignore[misc]
            served=served,
            worker=self._worker,
        )
        for name in self._sessions:
            forwarders[name] = CallForwarder(
                name,
                expression,
                deliveries=self._deliveries,
                owner=lambda key: self._claims.owner(key),
                asked=presence.asked,
            )
        self._present[expression] = presence, list(forwarders.values())
        presence.open()

    def close(self) -> None:
        """End all calls and stand-ins; safe to call twice."""
        self._worker.close()
        self.retire(())
        for forwarder in self._retired:
            forwarder.close()

    def idle(self) -> bool:
        """Return whether nothing is in process; services that have not answered yet do not count."""
        return all(forwarder.idle() for forwarder in self._forwarders())

    def held(self) -> Counter[str]:
        """Return how many requests and replies wait until they are due, by key."""
        return sum((forwarder.held() for forwarder in self._forwarders()), Counter())

    def shed(self) -> list[Mapping[str, int]]:
        """Return, for each forwarder, how many requests and replies per key there was no room for."""
        return [forwarder.shed for forwarder in self._forwarders()]

    def _forwarders(self) -> list[CallForwarder]:
        return [*self._retired, *itertools.chain(*(forwarders for _, forwarders in list(self._present.values())))]
