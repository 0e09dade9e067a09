"""Queries and their replies."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from riot_bus.doctor.conformance.helpers import (
    answer,
)
from riot_bus.doctor.conformance.samples import show_replies
from riot_bus.doctor.conformance.scenario import Observation, scenario

if TYPE_CHECKING:
    from riot_bus.doctor.conformance.end import ScenarioEnd

_TIMEOUT_S = 0.3  # each of up to `_ASKED` queries waits this long: 2.4 s in all
_ASKED = 8  # whether a timeout's error arrives is a race, so one query may show none; not measured


@scenario("many_replies")
class _ManyReplies:
    """Hundreds of replies to one query, puts and deletes, on several keys."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        end.meet()
        seen = show_replies(
            end.session.get(end.key("q/*"), consolidation=zenoh.ConsolidationMode.NONE, timeout=5.0),
        )
        end.together("asked")
        return seen

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        def reply(query: Any) -> None:
            for number in range(200):
                query.reply(end.key(f"q/{number}"), f"{number}", encoding="text/plain", attachment=b"\x00\x01")
            query.reply_del(end.key("q/gone"))
            query.reply(end.key("q/large"), bytes(1 << 20))

        queryable = answer(end, "q/*", reply)
        end.meet()
        end.together("asked")
        return str(queryable.key_expr)


@scenario("query_errors")
class _ErrorsAndTimeouts:
    """Error replies, a query that nobody answers, one that is answered too late, and one without a queryable."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        end.meet()
        seen: dict[str, Any] = {
            key: show_replies(end.session.get(end.key(key), timeout=5.0)) for key in ("error", "mixed", "nobody")
        }
        # Each router on the way times out as well: which of their errors arrive, and how many, is a race. Behind a
        # router with access control there may be none: Zenoh 1.10.2 treats errors of routers, which have no key, as
        # forbidden. So the query is repeated a few times, until an error arrives.
        seen["silent"], seen["silent waited"], seen["others"] = [], True, []
        for number in range(_ASKED):
            began = time.monotonic()
            replies = show_replies(end.session.get(f"{end.key('silent')}?n={number}", timeout=_TIMEOUT_S))
            seen["silent waited"] &= time.monotonic() - began > 0.9 * _TIMEOUT_S
            seen["others"] += [each for each in replies if each.get("error") != "Timeout"]
            if replies:
                seen["silent"] = [each.get("error") for each in replies][:1]
                break
        end.together("asked")
        return seen

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        def mixed(query: Any) -> None:
            query.reply(query.key_expr, "fine")
            query.reply_err(b"\xff\x00")

        kept: list[Any] = []
        queryables = [
            answer(end, "error", lambda query: query.reply_err("no", encoding="text/plain")),
            answer(end, "mixed", mixed),
            end.session.declare_queryable(end.key("silent"), kept.append),
        ]
        end.meet()
        end.together("asked")
        asked = [str(query.parameters) for query in kept]
        return [len(queryables), asked[:1], asked == [f"n={number}" for number in range(len(asked))]]


@scenario("query_contents")
class _QueryContents:
    """Payload, encoding, attachment and parameters of queries, and replies on other keys."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        end.meet()
        key = end.key("q/x")
        seen = [
            show_replies(replies)
            for replies in (
                end.session.get(key, timeout=5.0),
                end.session.get(f"{key}?a=1;b=two words;_time=[now(-1h)..]", timeout=5.0),
                end.session.get(key, payload=b"", attachment=b"", timeout=5.0),
                end.session.get(key, payload=bytes(1 << 20), encoding="text/x;y", attachment=b"\xff", timeout=5.0),
                end.session.get(key, accept_replies=zenoh.ReplyKeyExpr.ANY, timeout=5.0),
            )
        ]
        end.together("asked")
        return seen

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
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
            query.reply(end.key("elsewhere") if "ANY" in anywhere.upper() else query.key_expr, "answer")

        queryable = answer(end, "q/*", reply)
        end.meet()
        end.together("asked")
        return [asked, str(queryable.key_expr)]


@scenario("query_quality")
class _QueryQuality:
    """Priority and congestion control of queries, which replies take over."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        priorities: Any = zenoh.Priority
        end.meet()
        seen = []
        for priority in ("REAL_TIME", "DATA", "BACKGROUND"):
            for congestion in (zenoh.CongestionControl.DROP, zenoh.CongestionControl.BLOCK):
                level = getattr(priorities, priority)
                options = {"priority": level, "congestion_control": congestion, "express": True}
                seen += show_replies(end.session.get(end.key("q"), timeout=5.0, **options))
        end.together("asked")
        return seen

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        queryable = answer(end, "q", lambda query: query.reply(query.key_expr, "answer"))
        end.meet()
        end.together("asked")
        return str(queryable.key_expr)
