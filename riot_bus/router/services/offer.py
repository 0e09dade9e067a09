"""Whether a segment's components offer a service, before anybody calls it."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from riot_bus.router.services.presence import silent_querier
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import canonical, release

if TYPE_CHECKING:
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.zenoh import api as zenoh


class ServiceOffer:
    """Watches whether a service exists that others than this session serve, without calling it.

    The matching status of a querier that never asks tells it for a single key. The key of a ROS service also has its
    domain, type and hash, which the token of its server tells.

    Args:
        service: Name of the service, such as `map/size` or `/get_map`, without wildcards.

    Raises:
        ConfigError: The name is not that of a service.
    """

    def __init__(self, session: zenoh.Session, service: str, registry: TypeRegistry) -> None:
        self._session, self._service, self._registry = session, service, registry
        self._own = str(session.info.zid())
        self._lock = threading.Lock()
        self._keys: set[str] = set()
        self._queriers: dict[str, Any] = {}
        self._listeners: list[Any] = []
        (expression,) = canonical([registry.key_expression(service)])
        if "*" not in expression:
            self._keys.add(expression)
            return
        handler: Any = library_of(session).handlers.Callback(self._announced, indirect=False)
        self._listeners += [
            session.liveliness().declare_subscriber(each, handler, history=True) for each in registry.announcements()
        ]

    def there(self) -> bool:
        """Return whether the service exists now."""
        with self._lock:
            keys = sorted(self._keys)
        for key in keys:
            if key not in self._queriers:
                self._queriers[key] = silent_querier(self._session, key)
        return any(querier.matching_status.matching for querier in self._queriers.values())

    def close(self) -> None:
        """Stop watching; safe to call twice."""
        release(*self._listeners, *self._queriers.values())
        self._listeners.clear()
        self._queriers.clear()

    def _announced(self, sample: Any) -> None:
        """Note the key of a server of the service; whether the server still exists is told by matching."""
        found = self._registry.announcement(str(sample.key_expr))
        if found is None or found.role != "serves" or found.zid == self._own:
            return
        if self._registry.matches(self._service, found.key):
            with self._lock:
                self._keys.add(found.key)
