import math
import struct

import pytest

from riot_bus.inject.dictionary import eligible, load_dictionary
from riot_bus.inject.dictionary_file import TYPES

DICTIONARY = load_dictionary()


@pytest.mark.parametrize("kind", TYPES)
def test_every_type_has_reasoned_eligible_distinct_values(kind):
    entries = DICTIONARY.values_for(kind)
    assert len(entries) >= (2 if kind == "bool" else 10)
    assert all(eligible(kind, entry.value) and len(entry.reason) >= 5 for entry in entries)
    keys = [struct.pack("<d", e.value) if "float" in kind else e.value for e in entries]
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("kind", [kind for kind in TYPES if "int" in kind])
def test_integers_reach_their_limits_and_stay_small_too(kind):
    values = {entry.value for entry in DICTIONARY.values_for(kind)}
    bits = int(kind.lstrip("uint"))
    limits = {0, 2**bits - 1} if kind.startswith("u") else {-1, 0, -(2 ** (bits - 1)), 2 ** (bits - 1) - 1}
    assert limits | {1, 2, 3} <= values


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_floats_cover_the_special_ones(kind):
    values = [entry.value for entry in DICTIONARY.values_for(kind)]
    assert any(math.isnan(value) for value in values)
    assert {math.inf, -math.inf} <= set(values)
    assert any(value == 0 and math.copysign(1, value) < 0 for value in values)
    smallest_normal = 2.0**-126 if kind == "float32" else 2.0**-1022
    assert any(0 < abs(value) < smallest_normal for value in values)


def test_strings_are_utf_8():
    assert all(entry.value.encode() is not None for entry in DICTIONARY.values_for("string"))


@pytest.mark.parametrize(
    ("kind", "path", "tried", "untried"),
    [
        ("float64", "fix:lat", 90.0000001, 180.0000001),
        ("float64", "fix:where.Latitude", 90.0000001, 180.0000001),
        ("float64", "platform:flat", 90.0, 90.0000001),
        ("uint32", "map:info.width", 46_341, 46_342),
        ("float64", "odom:pose.covariance[7]", -1e-9, -2e-9),
        ("string", "log:opened_at", "2023-02-29T12:00:00Z", "256.256.256.256"),
        ("bool", "map:width", True, None),
    ],
)
def test_names_of_fields_suggest_values(kind, path, tried, untried):
    values = [entry.value for entry in DICTIONARY.values_for(kind, path)]
    assert tried in values
    assert untried not in values
