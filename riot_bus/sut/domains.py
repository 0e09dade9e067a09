"""ROS domains of DDS that nobody on this machine uses."""

from __future__ import annotations

import random
import socket
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["free_domains"]

_DOMAINS = range(1, 101)
_LOCK_PORT = 32_768
"""A domain is taken by binding this port plus its number, as ROS's domain_coordinator and colcon's do."""
_DDS_PORT, _PORTS_OF_DOMAIN = 7400, 250
"""First port, and distance between domains, of the ports on which participants discover each other."""


@contextmanager
def free_domains(count: int) -> Iterator[list[int]]:
    """Reserve domains that no other tests and no participants on this machine use, until the context ends.

    Raises:
        EnvironmentFaultError: Fewer domains than that are free.
    """
    with ExitStack() as stack:
        found: list[int] = []
        for number in random.SystemRandom().sample(_DOMAINS, len(_DOMAINS)):
            if len(found) == count:
                break
            with suppress(OSError):
                stack.enter_context(_taken(number))
                found.append(number)
        if len(found) < count:
            raise EnvironmentFaultError("all ROS domains from 1 to 100 are in use", hint="end some ROS nodes")
        yield found


@contextmanager
def _taken(number: int) -> Iterator[None]:
    with socket.socket() as lock, socket.socket(type=socket.SOCK_DGRAM) as probe:
        lock.bind(("", _LOCK_PORT + number))
        probe.bind(("", _DDS_PORT + _PORTS_OF_DOMAIN * number))
        probe.close()
        yield
