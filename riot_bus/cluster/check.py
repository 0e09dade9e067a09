"""Whether a cluster can take trials of a system: connects, and has each worker compare versions and code."""

from __future__ import annotations

import uuid
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgpack  # type: ignore[import-untyped]

from riot_bus.cluster.address import connect
from riot_bus.cluster.facts import facts_of
from riot_bus.cluster.workers import ask, begin_of, why_not

if TYPE_CHECKING:
    from riot_bus.sut.context import Context

__all__ = ["WorkerCheck", "check_cluster"]

_ANSWERS_WITHIN_S = 120.0  # as long as a worker itself waits for its versions and code (`remote._FACTS_WITHIN_S`)


@dataclass(frozen=True, slots=True)
class WorkerCheck:
    """The answer of a worker.

    Attributes:
        address: Address of the worker.
        host: Name of its machine; empty if it has not answered.
        refused: Why it takes no trials; empty if it does.
    """

    address: str
    host: str
    refused: str


def check_cluster(executor: str, context: Context) -> list[WorkerCheck]:
    """Ask all workers of a cluster whether they would take trials of a system.

    Raises:
        RiotError: As `connect` raises it.
    """
    client = connect(executor)
    try:
        facts = facts_of(context)
        threads: dict[str, int] = client.nthreads()
        wrong = {address: why for address, count in threads.items() if (why := why_not(address, count))}
        asked = {
            address: ask(client, address, begin_of(context, facts, name=uuid.uuid4().hex, slot=None))
            for address in threads
            if address not in wrong
        }
        found = [WorkerCheck(address, "", why) for address, why in wrong.items()]
        for address, future in asked.items():
            try:
                told = msgpack.unpackb(future.result(timeout=_ANSWERS_WITHIN_S))
                why = str(told.get("refused") or told.get("error") or "")
                found.append(WorkerCheck(address, str(told.get("host", "")), why))
            except Exception as error:
                found.append(WorkerCheck(address, "", f"no answer: {type(error).__name__} {error}".strip()))
        return sorted(found, key=lambda each: each.address)
    finally:
        client.close()
