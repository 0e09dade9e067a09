"""Are components there? Asked without the admin space: its queries can deadlock a router.

In zenoh 1.10.2 the admin space answers `publisher/**`, `subscriber/**` and the like while it holds the routing tables'
read lock and takes it again for each reply; when a component declares something in between, both wait for ever.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.bus.runtime import release, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import zenoh

__all__ = ["wait_matched"]

_INTERVAL_S = 0.002


def wait_matched(
    session: zenoh.Session, keys: Sequence[str], *, timeout: float, alive: Callable[[], bool] = lambda: True
) -> list[str]:
    """Wait until other sessions have subscribed to all keys.

    Observers of ours in other segments count as well, so this is exact only on a bus of one segment.

    Args:
        session: A segment's own session.
        keys: Keys without wildcards.
        timeout: Seconds.
        alive: Returns False when waiting has become pointless, because a component died.

    Returns:
        What nobody has subscribed to; empty when all went well.
    """
    import zenoh

    waiting = {
        key: session.declare_publisher(key, allowed_destination=zenoh.Locality.REMOTE) for key in dict.fromkeys(keys)
    }

    def all_matched() -> bool:
        for key, publisher in list(waiting.items()):
            # The status is an object, true even when nobody listens (zenoh 1.10.2 types it as bool).
            if getattr(publisher.matching_status, "matching", False):
                release(publisher)
                del waiting[key]
        return not waiting or not alive()

    wait_until(all_matched, timeout, interval=_INTERVAL_S)
    missing = list(waiting)
    release(*waiting.values())
    return missing
