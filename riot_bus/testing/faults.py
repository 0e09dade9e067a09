r"""Conformance tests for kinds of faults in injection plans, for their authors to inherit.

    class TestMine(FaultConformance):
        table = 'fault = "mine"\nstrength = 3'

Needs pytest: the extra `testing`.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, ClassVar

from riot_bus.inject.interceptor import Injector
from riot_bus.inject.plan import parse_plan, plan_to_toml
from riot_bus.testing.interceptors import InterceptorBench

if TYPE_CHECKING:
    from riot_bus.vocabulary.injection import Injection

_COUNT = 60  # with probability 0.5, two runs without a seed agree once in 2**60


class FaultConformance:
    """Tests of a kind of fault: it has an effect, only on the selected messages, and is deterministic.

    Attributes:
        table: Keys of an `[[inject]]` table without `topic`, as TOML; messages are JSON with a number `x`.
    """

    table: ClassVar[str]

    def test_it_does_something(self) -> None:
        """The delivered messages differ from the sent ones."""
        assert self._delivered() != self._delivered("[[inject]]\ntopic = 'other'\n" + self.table)

    def test_messages_that_are_not_selected_keep_their_bytes(self) -> None:
        """Messages of other topics, and those before the first selected number, are delivered unchanged."""
        plan = f"[[inject]]\ntopic = 'a'\nfirst = {_COUNT}\n{self.table}"
        assert self._delivered(plan) == self._delivered("[[inject]]\ntopic = 'other'\n" + self.table)

    def test_it_repeats_itself(self) -> None:
        """Equal messages, plans and seeds give equal results, even with a probability."""
        for more in ("", "probability = 0.5\n"):
            plan = f"[[inject]]\ntopic = 'a'\n{more}{self.table}"
            assert self._delivered(plan) == self._delivered(plan)

    def test_its_plan_survives_being_written(self) -> None:
        """`plan_to_toml` and `parse_plan` give the same injection back."""
        assert parse_plan(plan_to_toml(self._injections()), name="written") == self._injections()

    def test_a_message_that_it_cannot_change_is_passed_on(self) -> None:
        """No payload raises anything but PayloadError: the message passes, or is dropped on purpose."""
        with InterceptorBench(Injector(self._injections())) as bench:
            for number, payload in enumerate((b"", b"{", b"\x00" * 64, b"[1]", b'{"y": 1}')):
                bench.feed(number * 0.01, payload)
            assert not bench.errors, bench.errors

    def _injections(self) -> tuple[Injection, ...]:
        return parse_plan(f"[[inject]]\ntopic = 'a'\n{self.table}", name="table")

    def _delivered(self, plan: str | None = None) -> list[tuple[int, bytes]]:
        injections = self._injections() if plan is None else parse_plan(plan, name="plan")
        with InterceptorBench(Injector(injections, seed=7)) as bench:
            for number in range(_COUNT):
                bench.feed(number * 0.01, json.dumps({"x": number}).encode())
            assert not bench.errors, bench.errors
            return [(each.due, each.message.payload) for each in bench.delivered]
