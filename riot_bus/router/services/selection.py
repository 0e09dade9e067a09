"""The keys of the services that a user selects."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.types.serve import REQUEST, part_of
from riot_bus.zenoh.session import includes

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from riot_bus.types.registry import TypeRegistry


def service_keys(names: Iterable[str], registry: TypeRegistry) -> list[str]:
    """Return the keys to intercept for services and actions, as a user could write them.

    Example:
        `/fibonacci` of ROS: `/fibonacci/@request`, `/fibonacci/_action/*/@request`, `/fibonacci/_action/*`
    """
    found: list[str] = []
    for name in names:
        found.append(f"{name}/{REQUEST}")
        for each in registry.service_adapters():
            parts = each.action_parts(name)
            if parts is not None:
                found += [f"{parts}/{REQUEST}", parts]
    return list(dict.fromkeys(found))


def split(keys: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the topics and the services of keys to intercept; the key of any part of a call means the service."""
    topics: list[str] = []
    services: list[str] = []
    for key in keys:
        call = part_of(key)
        if call is None:
            topics.append(key)
        else:
            services.append(call[0])
    return topics, list(dict.fromkeys(services))


def is_served(expression: str, spaces: Sequence[str]) -> bool:
    """Return whether all keys that an expression matches are those of complete services (`HasServices.services`)."""
    return any(includes(space, expression) for space in spaces)


def with_spaces(expressions: Sequence[str], spaces: Sequence[str]) -> list[str]:
    """Return the expressions, preceded by the spaces of complete services that they include.

    These spaces need stand-ins of their own, which are complete. They come first, as the first expression that
    includes a key owns it.
    """
    inner = [space for space in spaces if any(includes(text, space) for text in expressions)]
    return list(dict.fromkeys([*inner, *expressions]))
