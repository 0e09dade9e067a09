"""Ways by which a peer tries to get something of an intercepted key to another segment, past the interceptors."""

from __future__ import annotations

import itertools
import json
import textwrap
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zenoh
from zenoh.ext import CacheConfig, HistoryConfig, MissDetectionConfig

from riot_bus.control.remote import ask
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until
from tests.integration.fault_tools import assert_rows_balance
from tests.integration.router_process import RouterProcess
from tests.tiers import scaled

pytestmark = pytest.mark.integration

SECRET = b"secret"
ALL, NONE = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
CUT = ("--intercept=cut/**", "--interceptor=drop probability=1")
"""Nothing of an intercepted key is let through."""


class Victim:
    """A component of the other segment that listens in every way there is, and notes what it hears."""

    def __init__(self, router: RouterProcess, stack: ExitStack) -> None:
        self.session = stack.enter_context(open_client(router.endpoints["unit"])).session
        self.heard: list[tuple[str, bytes]] = []
        self.things: list[Any] = [
            self.session.declare_subscriber(expression, self._take)
            for expression in ("**", "cut/**", "cut/*", "cut/x", "**/@adv/**", "cut/x/@adv/**", "@/**", "@riot/**")
        ]
        self.things.append(
            zenoh.ext.declare_advanced_subscriber(
                self.session, "cut/x", self._take, history=HistoryConfig(detect_late_publishers=True)
            )
        )
        for expression in ("**", "cut/**/@adv/**"):
            self.things.append(self.session.liveliness().declare_subscriber(expression, self._take, history=True))

    def _take(self, sample: zenoh.Sample) -> None:
        attached = sample.attachment.to_bytes() if sample.attachment is not None else b""
        self.heard.append((str(sample.key_expr), sample.payload.to_bytes() + attached))

    def asks(self, *selectors: str) -> None:
        """Ask as well, and note the answers."""
        for selector in selectors:
            for reply in self.session.get(selector, timeout=1.0, target=ALL, consolidation=NONE):
                if reply.ok is not None:
                    self._take(reply.ok)


def put(session: zenoh.Session) -> None:
    session.put("cut/x", SECRET)
    session.put("cut/x", b"x", attachment=SECRET)
    session.put("cut/x", SECRET, priority=zenoh.Priority.REAL_TIME, express=True)


def wildcards(session: zenoh.Session) -> None:
    for key in ("cut/*", "cut/**", "**", "*/x", "c$*t/x", "**/x", "$*u$*/**"):
        session.put(key, SECRET)


def declared(session: zenoh.Session) -> None:
    for key in ("cut/x", "cut", "**"):
        expression = session.declare_keyexpr(key)
        session.put(expression, SECRET)
        session.undeclare(expression)


def deletes(session: zenoh.Session) -> None:
    session.delete("cut/x", attachment=SECRET)
    session.delete("**", attachment=SECRET)


def advanced(session: zenoh.Session) -> None:
    publisher: Any = zenoh.ext.declare_advanced_publisher(
        session,
        "cut/x",
        cache=CacheConfig(max_samples=10),
        sample_miss_detection=MissDetectionConfig(heartbeat=0.05),
        publisher_detection=True,
    )
    publisher.put(SECRET)


def forged_cache(session: zenoh.Session) -> None:
    zid = session.info.zid()
    for key in (f"cut/x/@adv/pub/{zid}/7/_", f"cut/x/@adv/{zid}/7", "cut/x/@adv/x"):
        session.put(key, SECRET)
        session.declare_queryable(key, lambda query: query.reply("cut/x", SECRET), complete=True)
        session.liveliness().declare_token(key)


def admin_space(session: zenoh.Session) -> None:
    for reply in session.get("@/**", timeout=1.0, target=ALL):
        if reply.ok is not None:
            session.put(f"{reply.ok.key_expr}/cut/x", SECRET)
    for key in ("@/*/router/config/access_control", "@/**", "@/local/cut/x"):
        session.put(key, json.dumps({"enabled": False, "text": SECRET.decode()}))


def tokens(session: zenoh.Session) -> None:
    """Announce a publisher; that there is one is told in the other segment, by the router, and nothing else."""
    session.liveliness().declare_token(f"cut/x/{SECRET.decode()}/@adv/pub/1/2/_")


WAYS = (put, wildcards, declared, deletes, advanced, forged_cache, admin_space, tokens)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
def test_nothing_of_an_intercepted_key_crosses_uncounted(way: Callable[[zenoh.Session], None]) -> None:
    with RouterProcess(*CUT) as router, ExitStack() as stack:
        victim = Victim(router, stack)
        attacker = stack.enter_context(open_client(router.endpoints["system"])).session
        _pass(attacker, victim, b"begin")
        for number in range(2):  # the second time all routes are known
            way(attacker)
            victim.asks("cut/x/@adv/**", "cut/**/@adv/**?_anyke")
            _pass(attacker, victim, b"end %d" % number)  # what is not intercepted comes behind all that
        rows = ask(router.endpoints["system"], None, "counts")["counts"]
        victim.asks("@/**")  # only now: asked while something is declared, it can stop Zenoh for good (docs/router.md)
        assert [(key, data) for key, data in victim.heard if key.startswith("cut") and SECRET in data] == []
        assert_rows_balance(rows)
        assert sum(row["forwarded"] for row in rows.values()) == 0


@pytest.mark.parametrize("way", [way for way in WAYS if way is not admin_space], ids=lambda way: way.__name__)
def test_the_same_ways_do_cross_where_nothing_is_intercepted(way: Callable[[zenoh.Session], None]) -> None:
    with RouterProcess() as router, ExitStack() as stack:
        victim = Victim(router, stack)
        attacker = stack.enter_context(open_client(router.endpoints["system"])).session
        _pass(attacker, victim, b"begin")
        way(attacker)
        assert wait_until(lambda: any(key.startswith("cut") for key, _ in victim.heard), 60)


def test_an_admin_space_opens_nothing() -> None:
    with RouterProcess(*CUT) as router, ExitStack() as stack:
        victim = Victim(router, stack)
        attacker = stack.enter_context(open_client(router.endpoints["system"])).session
        _pass(attacker, victim, b"begin")
        replies = list(victim.session.get("@/*/router", timeout=2.0, target=ALL))
        zids = {str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok}
        assert zids
        for zid in zids:
            attacker.put(f"@/{zid}/router/config/access_control/enabled", "false")
            attacker.put(f"@/{zid}/router/config/connect/endpoints", '["tcp/127.0.0.1:1"]')
            attacker.delete(f"@/{zid}/router/config/access_control")
        put(attacker)
        _pass(attacker, victim, b"end")
        assert [(key, data) for key, data in victim.heard if key.startswith("cut")] == []
        assert ask(router.endpoints["system"], None, "counts")["counts"]["cut/x"]["dropped"] == 3


def _pass(attacker: zenoh.Session, victim: Victim, text: bytes) -> None:
    """Publish something that is not intercepted until it has come."""

    def came() -> bool:
        attacker.put("free/x", text)
        return ("free/x", text) in victim.heard

    assert wait_until(came, 60, interval=0.05)


def test_the_documented_rule_keeps_peers_from_stopping_zenoh(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs/router.md").read_text()
    section = page.partition("### What one peer can do")[2].partition("\n### ")[0]
    toml = textwrap.dedent("\n".join(line for line in section.splitlines() if line.startswith("    ") or not line))
    (tmp_path / "riot.toml").write_text(toml.replace("tcp/127.0.0.1:7447", "tcp/127.0.0.1:0"))
    over = threading.Event()
    with (
        RouterProcess("--intercept=cut/**", cwd=tmp_path, segments=False) as router,
        open_client(router.endpoints["system"]) as asker,
        open_client(router.endpoints["system"]) as declarer,
    ):

        def declare() -> None:
            for number in itertools.takewhile(lambda _: not over.is_set(), itertools.count()):
                subscriber: Any = declarer.session.declare_subscriber(f"a/{number}", lambda _: None)
                if number % 3 == 0:
                    subscriber.undeclare()

        thread = threading.Thread(target=declare)
        thread.start()
        try:
            for _ in range(scaled(400, gate=50)):  # without the rule the first ones stop the router for good
                told = [str(each.ok.key_expr) for each in asker.session.get("@/**", timeout=1.0) if each.ok]
                assert not [key for key in told if "/router" in key], "a session tells of itself, the router does not"
        finally:
            over.set()
            thread.join()

        def seen() -> bool:  # riot itself still sees who is there
            found = ask(router.endpoints["system"], None, "graph")["components"]
            return "system" in {each["segment"] for each in found}

        assert wait_until(seen, 60, interval=0.1)
