"""Queries and their replies: which queryables receive one, and which replies count."""

from __future__ import annotations

import time
from typing import Any

from riot_bus.zenoh import api as zenoh
from riot_bus_conformance.end import Observation, ScenarioEnd
from riot_bus_conformance.samples import show_replies
from riot_bus_conformance.scenario import scenario

_TIMEOUT_S = 0.3  # each of up to `_ASKED` queries waits this long: 2.4 s in all
_MODES: Any = zenoh.ConsolidationMode
_TARGETS: Any = zenoh.QueryTarget
_ASKED = 8  # whether a timeout's error arrives is a race, so one query may show none; not measured


@scenario("many_replies")
class _ManyReplies(ScenarioEnd):
    """Hundreds of replies to one query, puts and deletes, on several keys."""

    def left(self) -> Observation:
        self.meet()
        return self.ask("q/*", consolidation=zenoh.ConsolidationMode.NONE)

    def right(self) -> Observation:
        def reply(query: Any) -> None:
            for number in range(200):
                query.reply(self.key(f"q/{number}"), f"{number}", encoding="text/plain", attachment=b"\x00\x01")
            query.reply_del(self.key("q/gone"))
            query.reply(self.key("q/large"), bytes(1 << 20))

        self.answer("q/*", reply)
        self.meet()


@scenario("query_errors")
class _ErrorsAndTimeouts(ScenarioEnd):
    """Error replies, a query that nobody answers, one that is answered too late, and one without a queryable."""

    def left(self) -> Observation:
        self.meet()
        seen: dict[str, Any] = {key: self.ask(key) for key in ("error", "mixed", "nobody")}
        # Each router on the way times out as well: which of their errors arrive, and how many, is a race. Behind a
        # router with access control there may be none: Zenoh 1.10.2 treats errors of routers, which have no key, as
        # forbidden. So the query is repeated a few times, until an error arrives.
        seen["silent"], seen["silent waited"], seen["others"] = [], True, []
        for number in range(_ASKED):
            began = time.monotonic()
            replies = self.ask(f"silent?n={number}", timeout=_TIMEOUT_S)
            seen["silent waited"] &= time.monotonic() - began > 0.9 * _TIMEOUT_S
            seen["others"] += [each for each in replies if each.get("error") != "Timeout"]
            if replies:
                seen["silent"] = [each.get("error") for each in replies][:1]
                break
        self.together("asked")
        return seen

    def right(self) -> Observation:
        def mixed(query: Any) -> None:
            query.reply(query.key_expr, "fine")
            query.reply_err(b"\xff\x00")

        kept: list[Any] = []
        self.answer("error", lambda query: query.reply_err("no", encoding="text/plain"))
        self.answer("mixed", mixed)
        self.keep(self.session.declare_queryable(self.key("silent"), kept.append))
        self.meet()
        self.together("asked")
        asked = [str(query.parameters) for query in kept]
        return [asked[:1], asked == [f"n={number}" for number in range(len(asked))]]


@scenario("query_contents")
class _QueryContents(ScenarioEnd):
    """Payload, encoding, attachment and parameters of queries, and replies on other keys."""

    def left(self) -> Observation:
        self.meet()
        seen = [
            self.ask("q/x"),
            self.ask("q/x?a=1;b=two words;_time=[now(-1h)..]"),
            self.ask("q/x", payload=b"", attachment=b""),
            self.ask("q/x", payload=bytes(1 << 20), encoding="text/x;y", attachment=b"\xff"),
            self.ask("q/x", accept_replies=zenoh.ReplyKeyExpr.ANY),
        ]
        self.together("asked")
        return seen

    def right(self) -> Observation:
        asked: list[dict[str, Any]] = []

        def reply(query: Any) -> None:
            anywhere = str(query.accepts_replies())
            asked.append(
                {
                    "key": str(query.key_expr),
                    "parameters": str(query.parameters),
                    "payload": None if query.payload is None else len(query.payload.to_bytes()),
                    "encoding": None if query.encoding is None else str(query.encoding),
                    "attachment": None if query.attachment is None else query.attachment.to_bytes().hex(),
                    "accepts": anywhere,
                    "source": query.source_info is not None,
                }
            )
            query.reply(self.key("elsewhere") if "ANY" in anywhere.upper() else query.key_expr, "answer")

        self.answer("q/*", reply)
        self.meet()
        self.together("asked")
        return asked


@scenario("query_quality")
class _QueryQuality(ScenarioEnd):
    """Priority and congestion control of queries, which replies take over."""

    def left(self) -> Observation:
        levels: Any = zenoh.Priority
        self.meet()
        seen = []
        for priority in ("REAL_TIME", "DATA", "BACKGROUND"):
            for congestion in (zenoh.CongestionControl.DROP, zenoh.CongestionControl.BLOCK):
                seen += self.ask("q", priority=getattr(levels, priority), congestion_control=congestion, express=True)
        return seen

    def right(self) -> Observation:
        self.answer("q", lambda query: query.reply(query.key_expr, "answer"))
        self.meet()


@scenario("consolidation")
class _Consolidation(ScenarioEnd):
    """Every consolidation mode over two queryables that answer on the same key, old and new."""

    def left(self) -> Observation:
        self.meet()
        # a stand-in for a selected service comes a moment later
        self.matched(self.session.declare_querier(self.key("q")))
        modes = ("NONE", "LATEST", "AUTO", "MONOTONIC")
        seen = {mode: self.ask("q", consolidation=getattr(_MODES, mode)) for mode in modes}
        seen["MONOTONIC"] = seen["MONOTONIC"][-1:]  # whether the old one is seen depends on who is faster
        return seen

    def right(self) -> Observation:
        old = self.session.new_timestamp()
        new = self.session.new_timestamp()
        sessions = [self.session, self.open()]
        self.answer("q", lambda query: query.reply(self.key("q"), "1 old", timestamp=old), sessions[0])
        self.answer("q", lambda query: query.reply(self.key("q"), "2 new", timestamp=new), sessions[1])
        self.meet(*sessions)


@scenario("query_targets")
class _Targets(ScenarioEnd):
    """Every target with complete and partial queryables at both ends."""

    def left(self) -> Observation:
        self.answer("three/x", lambda query: query.reply(self.key("three/x"), "left"))
        self.meet()
        seen = {}
        for target in ("BEST_MATCHING", "ALL", "ALL_COMPLETE"):
            for key in ("one", "two", "three"):
                replies = self.ask(f"{key}/*", target=getattr(_TARGETS, target), consolidation=_MODES.NONE)
                seen[f"{target} {key}"] = [reply.get("payload") for reply in replies]
        return seen

    def right(self) -> Observation:
        sessions = [self.session, self.open(), self.open()]

        def declare(number: int, rest: str, *, complete: bool = False) -> None:
            key, text = self.key(rest.replace("*", "x")), f"{number} {complete}"
            self.answer(rest, lambda query: query.reply(key, text), sessions[number], complete=complete)

        declare(0, "one/*", complete=True)
        declare(1, "one/x")
        declare(0, "two/x")
        declare(1, "two/y")
        declare(2, "two/x", complete=True)
        declare(0, "three/*", complete=True)
        self.meet(*sessions)


@scenario("queriers")
class _Queriers(ScenarioEnd):
    """Declared queriers, and how they learn that queryables come and go."""

    def left(self) -> Observation:
        heard: list[bool] = []
        querier = self.session.declare_querier(self.key("q"), timeout=5.0)
        self.keep(querier.declare_matching_listener(lambda status: heard.append(status.matching)))
        self.meet()
        before = querier.matching_status.matching
        nobody = show_replies(querier.get())
        self.signal("declare")
        self.matched(querier)
        first = show_replies(querier.get(payload="1", parameters="a=1"))
        self.signal("undeclare")
        self.matched(querier, matching=False)
        self.until(lambda: heard[-1:] == [False], "the listener to hear of it")
        return [before, nobody, first, heard]

    def right(self) -> Observation:
        self.meet()
        self.wait("declare")
        queryable = self.answer("q", lambda query: query.reply(query.key_expr, str(query.parameters)))
        self.wait("undeclare")
        queryable.undeclare()
