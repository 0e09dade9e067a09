"""What all links have in common."""

from __future__ import annotations

import errno

from riot_bus_bridges.links.link import Link, cannot_listen
from riot_bus_bridges.mavlink.url import parse_link
from tests.unit.riot_bus_bridges.links.hosts import KeepingHost

SPEC = parse_link("tcpin:127.0.0.1:5760")


def test_the_state_tells_whether_a_link_has_an_end() -> None:
    host = KeepingHost()
    link = Link(SPEC, host)
    assert (link.state, link.where, link.dropped()) == ("listening", "127.0.0.1:5760", 0)
    ends = [link.join(address, lambda data: True) for address in ("one", "two")]
    assert host.ends == ends
    assert link.state == "connected"
    link.leave(ends[0])
    assert host.ends == ends[1:]
    link.close()
    assert (host.ends, link.state) == ([], "listening")
    host.loop.close()


def test_an_error_says_what_to_do() -> None:
    error = cannot_listen(SPEC, OSError(errno.EADDRINUSE, "Address already in use"))
    assert "cannot listen: Address already in use" in str(error)
    assert "another port" in str(error.hint)
    assert cannot_listen(SPEC, OSError(errno.EACCES, "Permission denied")).hint is None
