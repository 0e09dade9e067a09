from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from riot_bus.vocabulary.flags import Flag, flags_of


@dataclass(frozen=True)
class Wanted:
    room_size: Annotated[int, Flag("How much.", "-r")] = 1
    keep: Annotated[bool, Flag("Keep it.", "-k")] = True
    again: Annotated[bool, Flag("Again.")] = False
    names: Annotated[Sequence[str], Flag("Whose.", "--name -n")] = ()
    hidden: int = 7


def test_fields_with_a_flag_are_options_with_these_names() -> None:
    assert {field.name: names for field, _, names in flags_of(Wanted)} == {
        "room_size": ["--room-size", "-r"],
        "keep": ["--keep/--no-keep", "-k"],
        "again": ["--again"],
        "names": ["--name", "-n"],
    }
    assert [flag.help for _, flag, _ in flags_of(Wanted)] == ["How much.", "Keep it.", "Again.", "Whose."]
