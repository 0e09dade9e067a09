"""Which queryables receive a query, and which of their replies count."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.doctor.conformance.helpers import (
    answer,
)
from riot_bus.doctor.conformance.samples import show_replies
from riot_bus.doctor.conformance.scenario import Observation, scenario

if TYPE_CHECKING:
    from riot_bus.doctor.conformance.end import ScenarioEnd


@scenario("consolidation")
class _Consolidation:
    """Every consolidation mode over two queryables that answer on the same key, old and new."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        end.meet()
        end.matched(end.session.declare_querier(end.key("q")))  # a stand-in for a selected service comes a moment later
        seen = {}
        for mode in ("NONE", "LATEST", "AUTO"):
            consolidation = getattr(zenoh.ConsolidationMode, mode)
            replies = end.session.get(end.key("q"), consolidation=consolidation, timeout=5.0)
            seen[mode] = show_replies(replies)
        replies = end.session.get(end.key("q"), consolidation=zenoh.ConsolidationMode.MONOTONIC, timeout=5.0)
        seen["MONOTONIC"] = show_replies(replies)[-1:]  # whether the old one is seen depends on who is faster
        end.together("asked")
        return seen

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        old = end.session.new_timestamp()
        new = end.session.new_timestamp()
        sessions = [end.session, end.open()]
        queryables = [
            answer(end, "q", lambda query: query.reply(end.key("q"), "1 old", timestamp=old), session=sessions[0]),
            answer(end, "q", lambda query: query.reply(end.key("q"), "2 new", timestamp=new), session=sessions[1]),
        ]
        end.meet(*sessions)
        end.together("asked")
        return len(queryables)


@scenario("query_targets")
class _Targets:
    """Every target with complete and partial queryables at both ends."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        targets: Any = zenoh.QueryTarget
        own = answer(end, "three/x", lambda query: query.reply(end.key("three/x"), "left"))
        end.meet()
        seen = {}
        for target in ("BEST_MATCHING", "ALL", "ALL_COMPLETE"):
            for key in ("one", "two", "three"):
                replies = end.session.get(
                    end.key(f"{key}/*"),
                    target=getattr(targets, target),
                    consolidation=zenoh.ConsolidationMode.NONE,
                    timeout=5.0,
                )
                seen[f"{target} {key}"] = [reply.get("payload") for reply in show_replies(replies)]
        end.together("asked")
        return seen, str(own.key_expr)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        sessions = [end.session, end.open(), end.open()]

        def declare(number: int, rest: str, *, complete: bool = False) -> Any:
            key = end.key(rest.replace("*", "x"))
            text = f"{number} {complete}"
            session = sessions[number]
            return answer(end, rest, lambda query: query.reply(key, text), session=session, complete=complete)

        queryables = [
            declare(0, "one/*", complete=True),
            declare(1, "one/x"),
            declare(0, "two/x"),
            declare(1, "two/y"),
            declare(2, "two/x", complete=True),
            declare(0, "three/*", complete=True),
        ]
        end.meet(*sessions)
        end.together("asked")
        return len(queryables)


@scenario("queriers")
class _Queriers:
    """Declared queriers, and how they learn that queryables come and go."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        heard: list[bool] = []
        querier = end.session.declare_querier(end.key("q"), timeout=5.0)
        listener = querier.declare_matching_listener(lambda status: heard.append(status.matching))
        end.meet()
        before = querier.matching_status.matching
        nobody = show_replies(querier.get())
        end.signal("declare")
        end.matched(querier)
        first = show_replies(querier.get(payload="1", parameters="a=1"))
        end.signal("undeclare")
        end.matched(querier, matching=False)
        end.until(lambda: heard[-1:] == [False], "the listener to hear of it")
        end.together("done")
        return [before, nobody, first, heard, listener is not None]

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        end.meet()
        end.wait("declare")
        queryable = answer(end, "q", lambda query: query.reply(query.key_expr, str(query.parameters)))
        end.wait("undeclare")
        queryable.undeclare()
        end.together("done")
        return None
