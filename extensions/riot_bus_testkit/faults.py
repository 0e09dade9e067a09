r"""Conformance tests for kinds of faults in injection plans, for their authors to inherit.

    class TestMine(FaultConformance):
        table = 'fault = "mine"\nstrength = 3'

Needs pytest: the extra `testing`.
"""

from __future__ import annotations

from typing import ClassVar

from riot_bus.inject.interceptor import Injector
from riot_bus.inject.plan import parse_plan
from riot_bus.vocabulary.injection import Injection
from riot_bus_testkit.interceptors import InterceptorConformance, delivered_of


class FaultConformance(InterceptorConformance):
    """Tests of a kind of fault: those of an interceptor, and that it has an effect on the selected messages alone.

    Attributes:
        table: Keys of an `[[inject]]` table without `topic`, as TOML; messages are JSON with a number `x`.
    """

    table: ClassVar[str]

    def make(self) -> Injector:
        """Return an injector of the fault with a probability, which a seed decides."""
        return Injector(self._plan("probability = 0.5"), seed=7)

    def test_it_does_something(self) -> None:
        """The delivered messages differ from the sent ones."""
        assert delivered_of(Injector(self._plan())) != delivered_of(Injector(()))

    def test_messages_that_are_not_selected_keep_their_bytes(self) -> None:
        """Messages of other topics, and those before the first selected number, are delivered unchanged."""
        for plan in (self._plan(topic="other"), self._plan("first = 1000")):
            assert delivered_of(Injector(plan)) == delivered_of(Injector(()))

    def _plan(self, more: str = "", *, topic: str = "a") -> tuple[Injection, ...]:
        return parse_plan(f"[[inject]]\ntopic = '{topic}'\n{more}\n{self.table}", name="table")
