"""Which queryables receive a query, and which of their replies count."""

from __future__ import annotations

from typing import Any

from riot_bus.zenoh import api as zenoh
from riot_bus_conformance.end import Observation, ScenarioEnd
from riot_bus_conformance.samples import show_replies
from riot_bus_conformance.scenario import scenario

_MODES: Any = zenoh.ConsolidationMode
_TARGETS: Any = zenoh.QueryTarget


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
