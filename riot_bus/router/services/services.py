"""All intercepted services of a bus."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import TYPE_CHECKING

from riot_bus.router.advanced.worker import Worker
from riot_bus.router.services.forwarder import CallLane
from riot_bus.router.services.presence import Presence
from riot_bus.router.services.selection import is_served, with_spaces
from riot_bus.zenoh.convert import Claims

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from riot_bus.router.delivery_queue import DeliveryQueue
    from riot_bus.zenoh import api as zenoh

__all__ = ["Services"]


class Services:
    """Stands in for the selected services of each segment in the others, which the junction keeps apart.

    Args:
        sessions: The segments' own sessions.
        crossing: Queue that takes messages through the interceptors.
        sequence: Numbers for calls.
        spaces: Key expressions of complete services (`HasServices.services`).
    """

    def __init__(
        self,
        sessions: Mapping[str, zenoh.Session],
        crossing: DeliveryQueue,
        *,
        sequence: Iterator[int],
        spaces: Sequence[str] = (),
    ) -> None:
        self._sessions, self._crossing, self._sequence, self._spaces = sessions, crossing, sequence, spaces
        self._claims = Claims([])
        self._present: dict[str, tuple[Presence, list[CallLane]]] = {}
        self._retired: list[CallLane] = []
        self._worker = Worker("riot-services")

    def retire(self, expressions: Sequence[str]) -> None:
        """Stop standing in for all others than these; call this while the junction still keeps them apart.

        Open calls continue.
        """
        wanted = with_spaces(expressions, self._spaces)
        for expression in [text for text in self._present if text not in wanted]:
            presence, lanes = self._present.pop(expression)
            presence.close()
            for lane in lanes:
                lane.retire()
            self._retired += lanes

    def select(self, expressions: Sequence[str]) -> None:
        """Stand in for these services; call this once the junction keeps them apart."""
        wanted = with_spaces(expressions, self._spaces)
        self._claims = Claims(wanted)
        for expression in wanted:
            if expression not in self._present:
                self._begin(expression)

    def _begin(self, expression: str) -> None:
        served = is_served(expression, self._spaces)
        lanes: dict[str, CallLane] = {}
        presence = Presence(
            expression,
            self._sessions,
            {name: (lambda query, name=name: lanes[name].take(query)) for name in self._sessions},  # type: ignore[misc]
            served=served,
            worker=self._worker,
        )
        for name in self._sessions:
            lanes[name] = CallLane(
                name,
                expression,
                sessions=self._sessions,
                crossing=self._crossing,
                sequence=self._sequence,
                owner=lambda key: self._claims.owner(key),
                asked=presence.asked,
            )
        self._present[expression] = presence, list(lanes.values())
        presence.open()

    def close(self) -> None:
        """End all calls and stand-ins; safe to call twice."""
        self._worker.close()
        self.retire(())
        for lane in self._retired:
            lane.close()

    def idle(self) -> bool:
        """Return whether nothing is in process; services that have not answered yet do not count."""
        return all(lane.idle() for lane in self._lanes())

    def held(self) -> Counter[str]:
        """Return how many requests and replies wait until they are due, by key."""
        return sum((lane.held() for lane in self._lanes()), Counter())

    def shed(self) -> list[Mapping[str, int]]:
        """Return, for each lane, how many requests and replies per key there was no room for."""
        return [lane.shed for lane in self._lanes()]

    def _lanes(self) -> list[CallLane]:
        return [*self._retired, *itertools.chain(*(lanes for _, lanes in list(self._present.values())))]
