"""Every mutation that ships does what it says to a real message, and nothing else."""

from __future__ import annotations

import math
import re
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.inject.apply import inject_log
from riot_bus.inject.dictionary import load_dictionary
from riot_bus.inject.formula import parse_formula
from riot_bus.inject.mutations import Mutation, mutate
from riot_bus.types.capabilities import ListsParts
from riot_bus.types.model import MessageType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Scalar
from tests.mutated import breaks
from tests.tiers import folded, scaled
from tests.unit.dictionaries.sound import ADAPTER, MAVLINK, SOUND, accept, blank, sound, type_named

DICTIONARY = load_dictionary()
MUTATIONS = [mutation for name in SOUND for mutation in DICTIONARY.mutations_for(name)]
_ALL = 1 << 17

each_mutation = folded(
    "mutation", MUTATIONS, by=lambda each: each.type, name=lambda each: f"{each.type}: {each.reason}"
)


def fields(kind: MessageType, payload: bytes) -> dict[str, Scalar]:
    return {leaf.path: leaf.value for leaf in kind.leaves(payload, elements=_ALL)}


def same(one: Scalar, two: Scalar) -> bool:
    if isinstance(one, float) and isinstance(two, float):
        return struct.pack("<d", one) == struct.pack("<d", two) or (math.isnan(one) and math.isnan(two))
    return one == two


def touched(changes) -> re.Pattern[str]:
    """What may differ: the fields that are set, and the elements of arrays whose length is."""
    patterns = []
    for path, _ in changes:
        each = re.escape(path).replace(r"\[\*\]", r"\[\d+\]")
        patterns.append(each)
        if path.startswith("len("):
            patterns.append(re.escape(path[4:-1]) + r"\[\d+\].*")
            patterns.append(r"len\(" + re.escape(path[4:-1]) + r"\[\d+\].*")
    return re.compile("|".join(patterns))


def check(kind: MessageType, before: bytes, after: bytes, mutation: Mutation, base: str = "") -> None:
    pattern = touched(mutation.at(base))
    old, new = fields(kind, before), fields(kind, after)
    different = [
        path for path in old.keys() | new.keys() if path not in old or path not in new or not same(old[path], new[path])
    ]
    assert different, "nothing was changed"
    assert [path for path in different if not pattern.fullmatch(path)] == []
    shrunk_or_grown = [path for path, _ in mutation.at(base) if path.startswith("len(")]
    for length in shrunk_or_grown:  # what stays of an array stays as it was, unless it is set as well
        array = length[4:-1]
        others = touched([each for each in mutation.at(base) if each[0] != length])
        for path in old.keys() & new.keys():
            if path.startswith(f"{array}[") and not others.fullmatch(path):
                assert same(old[path], new[path]), path


def test_all_types_have_a_sound_message_here() -> None:
    names = {mutation.type for name in SOUND for mutation in DICTIONARY.mutations_for(name)}
    assert names == set(DICTIONARY.mutated_types())
    packages = {name.split("/")[0] for name in names}
    common = {"diagnostic_msgs", "geometry_msgs", "mavlink", "nav_msgs", "sensor_msgs", "shape_msgs", "std_msgs",
              "stereo_msgs", "trajectory_msgs", "visualization_msgs"}  # fmt: skip
    assert common <= packages


@each_mutation
def test_mutation_contradicts_a_sound_message_and_changes_nothing_else(mutation: Mutation) -> None:
    kind, before = type_named(mutation.type), sound(mutation.type)
    assert not breaks(mutation, kind, before), "the message that is to be contradicted is not sound"
    after = mutate(kind, before, mutation.at(""))
    check(kind, before, after, mutation)
    if mutation.consistent:
        assert breaks(mutation, kind, after)
    accept(mutation.type, after)


@each_mutation
def test_injections_of_a_mutation_do_the_same(mutation: Mutation) -> None:
    kind, before = type_named(mutation.type), sound(mutation.type)
    registry = TypeRegistry([MAVLINK, ADAPTER], declared={"a": mutation.type})
    plan = [Injection("a", path, value) for path, value in mutation.at("")]
    ((delivered,), ((_, original, changes),)) = inject_log([Message(1, "a", before)], plan, registry=registry)
    assert delivered.payload == mutate(kind, before, mutation.at(""))
    assert original.payload == before
    assert [change.field for change in changes] == [path for path, _ in mutation.at("")]


@pytest.mark.parametrize("outer", ["nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseArray", "nav_msgs/msg/Path"])
def test_mutations_hold_wherever_their_type_is_nested(outer: str) -> None:
    kind = type_named(outer)
    assert isinstance(kind, ListsParts)
    empty = blank(outer)
    lengths = {path: 2 for path in fields(kind, empty) if path.startswith("len(")}
    payload = kind.rebuild(empty, lengths)
    done = 0
    for part in kind.parts():
        base = part.path.replace("[*]", "[1]")
        for mutation in DICTIONARY.mutations_for(part.type_name) if base else ():
            inner = {f"{base}.{path}": value for path, value in SOUND[part.type_name].items() if "len(" not in path}
            if len(inner) < len(SOUND[part.type_name]):
                continue
            before = kind.rebuild(payload, inner)
            assert not breaks(mutation, kind, before, base)
            after = mutate(kind, before, mutation.at(base))
            check(kind, before, after, mutation, base)
            assert not mutation.consistent or breaks(mutation, kind, after, base)
            done += 1
    assert done > 5


@settings(deadline=None, max_examples=scaled(200))
@given(st.data())
def test_whatever_else_is_in_the_message(data: st.DataObject) -> None:
    mutation = data.draw(st.sampled_from([each for each in MUTATIONS if each.consistent]))
    kind, payload = type_named(mutation.type), sound(mutation.type)
    told = touched(
        [(path, 0) for path in [*parse_formula(mutation.consistent).fields, *(path for path, _ in mutation.changes)]]
    )
    free = [leaf for leaf in kind.leaves(payload) if not told.fullmatch(leaf.path) and isinstance(leaf.value, float)]
    values = data.draw(st.lists(st.floats(), min_size=len(free), max_size=len(free)))
    payload = kind.patch(payload, {leaf.path: value for leaf, value in zip(free, values, strict=True)})
    assert not breaks(mutation, kind, payload)
    after = mutate(kind, payload, mutation.at(""))
    check(kind, payload, after, mutation)
    assert breaks(mutation, kind, after)
