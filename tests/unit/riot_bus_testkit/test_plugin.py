from __future__ import annotations

from itertools import count

import pytest

from riot_bus_testkit.plugin import PluginConformance


class Sound(PluginConformance):
    def usual(self) -> int:
        return 1

    def strange(self) -> list[str]:
        return []


class Unsound(PluginConformance):
    numbers = count()

    def usual(self) -> int:
        return next(self.numbers)

    def strange(self) -> list[str]:
        return ["IndexError"]


def test_a_sound_plug_in_passes() -> None:
    Sound().test_it_repeats_itself()
    Sound().test_strange_inputs_are_survived()


def test_one_that_keeps_a_state_or_raises_is_found() -> None:
    with pytest.raises(AssertionError):
        Unsound().test_it_repeats_itself()
    with pytest.raises(AssertionError):
        Unsound().test_strange_inputs_are_survived()
