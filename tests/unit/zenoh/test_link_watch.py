from __future__ import annotations

from riot_bus.zenoh.link_watch import TransportWatch


def test_watch_tells_leaving_from_breaking() -> None:
    longest = {"s": 0.0}
    watch = TransportWatch(1.0, inner=lambda: {"now"}, ours=lambda: {"former", "now"}, longest=longest.__getitem__)
    for peer in ("former", "left", "back"):
        watch.event("s", peer, opened=True)
        watch.event("s", peer, opened=False)
    assert (watch.departures, watch.broken) == (2, [])
    watch.event("s", "back", opened=True)
    watch.event("s", "now", opened=False)
    longest["s"] = 0.9
    watch.event("s", "slow", opened=False)
    assert [(link.peer, link.reason) for link in watch.broken] == [
        ("back", "reconnected"),
        ("now", "inner"),
        ("slow", "stalled"),
    ]
    assert watch.departures == 1
    watch.stop()
    watch.event("s", "now", opened=False)
    assert len(watch.broken) == 3
