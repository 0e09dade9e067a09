"""Kinds of rules with their variables, and the distributions that learnt rules are judged on.

The first fourteen are those of the first release, with its small dictionary. The others have the dictionaries that
riot_bus ships, as the chain gives them to the learner.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from riot_bus.generalize.numbers import between, step
from riot_bus.generalize.rules import Variable
from riot_bus.generalize.sampling import fit, integer_range
from riot_bus.inject.dictionary import load_dictionary
from riot_bus.vocabulary.elements import Elements, Setting
from riot_bus.vocabulary.trial import Scalar

__all__ = ["FIRST", "SHAPES", "Shape", "canonical", "held_out", "near_limits", "variables_of"]

Values = Mapping[str, Any]
SIZE = 12
"""Elements of each array."""
FIRST = 14
"""So many of the shapes are those of the first release."""


@dataclass(frozen=True)
class Shape:
    """One kind of rule: what fails, and the variables with type, failing value and nominal range or values.

    `texts` are the rules that a maintainer would write; a learnt text is exact if it is one of them, apart from the
    order of its terms and literals. `also` draws cases that chance alone hardly has, a fourth of those held out.
    """

    name: str
    fails: Callable[[Values], bool]
    variables: tuple[tuple[str, str, Any, Any, Any], ...]
    texts: tuple[str, ...]
    also: Callable[[random.Random], dict[str, Scalar]] | None = None


def quotient(a: float, b: float) -> float:
    with np.errstate(all="ignore"):
        return float(np.float64(a) / np.float64(b))


def signed(value: int, bits: int) -> int:
    """Return what a signed integer of so many bits holds of a value."""
    return (value + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1)


def _image(width: int, height: int) -> dict[str, Scalar]:
    return {"w": width, "h": height, "len(data)": width * height}


INT_MAX = 2**31 - 1
SHAPES = (
    Shape(
        "x*y<0 or >1e6, float",
        lambda v: v["x"] * v["y"] < 0 or v["x"] * v["y"] > 1e6,
        (("x", "float64", -1.0, 1.0, 400.0), ("y", "float64", 20.0, 1.0, 400.0)),
        ("x * y < 0 or x * y > 1000000",),
    ),
    Shape(
        "x*y<0 or >1e6, int",
        lambda v: v["x"] * v["y"] < 0 or v["x"] * v["y"] > 10**6,
        (("x", "int32", -1, 1, 400), ("y", "int32", 20, 1, 400)),
        ("x * y < 0 or x * y > 1000000",),
    ),
    Shape(
        "x>1000",
        lambda v: v["x"] > 1000,
        (("x", "float64", 1e6, 0.0, 10.0), ("y", "float64", 2.0, 0.0, 10.0)),
        ("x > 1000",),
    ),
    Shape(
        "non-finite",
        lambda v: not math.isfinite(v["x"]),
        (("x", "float64", math.nan, 0.0, 10.0), ("y", "int32", 3, 0, 9)),
        ("not isfinite(x)",),
    ),
    Shape(
        "|x|>50 and mode==2",
        lambda v: abs(v["x"]) > 50 and v["mode"] == 2,
        (("x", "float64", 1e6, -5.0, 5.0), ("mode", "int32", 2, 0, 4)),
        ("mode == 2 and abs(x) > 50",),
    ),
    Shape(
        "x-y>10",
        lambda v: v["x"] - v["y"] > 10,
        (("x", "float64", 1e6, 0.0, 5.0), ("y", "float64", 2.0, 0.0, 5.0)),
        ("x - y > 10",),
    ),
    Shape(
        "hypot>200",
        lambda v: float(np.hypot(v["x"], v["y"])) > 200,
        (("x", "float64", 1e6, 0.0, 50.0), ("y", "float64", 2.0, 0.0, 50.0)),
        ("hypot(x, y) > 200",),
    ),
    Shape(
        "index out of 0..w",
        lambda v: v["i"] < 0 or v["i"] >= v["w"],
        (("i", "int32", -1, 0, 99), ("w", "int32", 200, 100, 400)),
        ("i < 0 or i >= w",),
    ),
    Shape("n==0", lambda v: v["n"] == 0, (("n", "uint32", 0, 1, 400), ("y", "float64", 2.0, 0.0, 50.0)), ("n == 0",)),
    Shape(
        "w*h>2^31",
        lambda v: v["w"] * v["h"] > 2**31,
        (("w", "uint32", 2**32 - 1, 1, 2000), ("h", "uint32", 480, 1, 2000)),
        ("w * h > 2147483648",),
    ),
    Shape(
        "box and range",
        lambda v: 100 < v["x"] < 1000 and v["y"] > 50,
        (("x", "float64", 500.0, 0.0, 50.0), ("y", "float64", 60.0, 0.0, 100.0)),
        ("x < 1000 and x > 100 and y > 50",),
    ),
    Shape(
        "x<0 or nan",
        lambda v: v["x"] < 0 or math.isnan(v["x"]),
        (("x", "float64", -1.0, 0.0, 10.0), ("y", "float64", 2.0, 0.0, 10.0)),
        ("x < 0 or isnan(x)",),
    ),
    Shape(
        "x*y<0 and mode",
        lambda v: v["x"] * v["y"] < 0 and v["mode"] == "auto",
        (
            ("x", "int32", -1, 1, 400),
            ("y", "int32", 20, 1, 400),
            ("mode", "string", "auto", ("auto", "manual", "off"), 0),
        ),
        ('mode == "auto" and x * y < 0',),
    ),
    Shape(
        "a/b>100",
        lambda v: quotient(v["a"], v["b"]) > 100,
        (("a", "float64", 1e6, 0.0, 50.0), ("b", "float64", 2.0, 1.0, 50.0)),
        ("a / b > 100",),
    ),
    # -- numbers: coefficients, three fields, residues, bits ----------------------------------------------------------
    Shape(
        "400*y+x>160000, int",
        lambda v: 400 * v["y"] + v["x"] > 160000,
        (("x", "int32", 5, 0, 399), ("y", "int32", 10**6, 0, 399)),
        ("400 * y + x > 160000",),
    ),
    Shape(
        "index 640*y+x beside size",
        lambda v: 640 * v["y"] + v["x"] >= v["size"],
        (("x", "uint32", 5, 0, 639), ("y", "uint32", 65535, 0, 479), ("size", "uint32", 307200, 307200, 307200)),
        ("640 * y + x >= size",),
    ),
    Shape(
        "x+y>2z",
        lambda v: v["x"] + v["y"] > 2 * v["z"],
        (("x", "float64", 1e6, 0.0, 5.0), ("y", "float64", 2.0, 0.0, 5.0), ("z", "float64", 8.0, 6.0, 20.0)),
        ("x + y > 2 * z",),
    ),
    Shape(
        "x+y+z>1000",
        lambda v: v["x"] + v["y"] + v["z"] > 1000,
        (("x", "float64", 1e6, 0.0, 50.0), ("y", "float64", 2.0, 0.0, 50.0), ("z", "float64", 8.0, 0.0, 50.0)),
        ("x + y + z > 1000",),
    ),
    Shape(
        "x*y*z>1e6",
        lambda v: v["x"] * v["y"] * v["z"] > 1e6,
        (("x", "float64", 1e9, 0.0, 20.0), ("y", "float64", 2.0, 1.0, 20.0), ("z", "float64", 8.0, 1.0, 20.0)),
        ("x * y * z > 1000000",),
    ),
    Shape(
        "w*h*channels>2^31",
        lambda v: v["w"] * v["h"] * v["c"] > 2**31,
        (("w", "uint32", 2**32 - 1, 1, 2000), ("h", "uint32", 480, 1, 2000), ("c", "uint8", 3, 1, 4)),
        ("w * h * c > 2147483648",),
    ),
    Shape(
        "len!=w*h",
        lambda v: v["len(data)"] != v["w"] * v["h"],
        (("w", "uint32", 2**31, 20, 20), ("h", "uint32", 10, 10, 10), ("len(data)", "uint16", 200, 200, 200)),
        ("len(data) != w * h", "w * h != len(data)"),
        lambda chance: (lambda w, h: {"w": w, "h": h, "len(data)": w * h})(
            chance.randint(1, 255), chance.randint(1, 255)
        ),
    ),
    Shape("n%4!=0", lambda v: v["n"] % 4 != 0, (("n", "int32", 7, (4, 8, 16, 400), 0),), ("n % 4 != 0",)),
    Shape(
        "n%10==3 and n>100",
        lambda v: v["n"] % 10 == 3 and v["n"] > 100,
        (("n", "uint32", 1003, 0, 99),),
        ("n > 100 and n % 10 == 3",),
    ),
    Shape(
        "flags&8",
        lambda v: bool(v["flags"] & 8),
        (("flags", "uint8", 255, (0, 1, 4, 5), 0), ("x", "float64", 2.0, 0.0, 10.0)),
        ("(flags & 8) != 0",),
    ),
    Shape(
        "flags&4096 and not flags&1",
        lambda v: bool(v["flags"] & 4096) and not v["flags"] & 1,
        (("flags", "uint32", 4096, (0, 1, 3, 16), 0),),
        ("(flags & 1) == 0 and (flags & 4096) != 0", "(flags & 4096) != 0 and flags % 2 == 0"),
    ),
    # -- wrap-around --------------------------------------------------------------------------------------------------
    Shape(
        "y+h wraps uint32",
        lambda v: v["y"] > 480 and (v["y"] + v["h"]) % 2**32 <= 480,
        (("y", "uint32", 2**32 - 1, 0, 100), ("h", "uint32", 240, 100, 380)),
        ("y > 480 and (y + h) % 2**32 <= 480",),
        lambda chance: {"y": 2**32 - chance.randint(1, 2000), "h": chance.randint(1, 2000)},
    ),
    Shape(
        "y-h wraps uint32",
        lambda v: (v["y"] - v["h"]) % 2**32 > 1000,
        (("y", "uint32", 0, 240, 480), ("h", "uint32", 240, 0, 239)),
        ("(y - h) % 2**32 > 1000",),
    ),
    Shape(
        "w*h wraps uint32",
        lambda v: v["w"] > 0 and v["h"] > 0 and (v["w"] * v["h"]) % 2**32 < 16,
        (("w", "uint32", 65536, 16, 2000), ("h", "uint32", 65536, 16, 2000)),
        ("h > 0 and w > 0 and (w * h) % 2**32 < 16", "w * h > 0 and (w * h) % 2**32 < 16"),
        lambda chance: {
            "w": chance.randint(1, 9) << chance.randint(0, 28),
            "h": chance.randint(1, 9) << chance.randint(0, 28),
        },
    ),
    Shape(
        "a+b wraps int32",
        lambda v: signed(v["a"] + v["b"], 32) < 0,
        (("a", "int32", INT_MAX, 0, 1000), ("b", "int32", 100, 0, 1000)),
        ("int32(a + b) < 0",),
    ),
    Shape(
        "a-b wraps int16",
        lambda v: signed(v["a"] - v["b"], 16) > 500,
        (("a", "int16", -32768, -200, 200), ("b", "int16", 100, -200, 200)),
        ("int16(a - b) > 500",),
    ),
    Shape(
        "w*h wraps int32",
        lambda v: signed(v["w"] * v["h"], 32) < 0,
        (("w", "int32", INT_MAX, 1, 2000), ("h", "int32", 480, 1, 2000)),
        ("int32(w * h) < 0",),
    ),
    Shape(
        "int8 of an int32",
        lambda v: signed(v["n"], 8) < -20,
        (("n", "int32", 200, 0, 100), ("x", "float64", 2.0, 0.0, 10.0)),
        ("int8(n) < -20",),
    ),
    Shape(
        "uint16 of a sum of int32",
        lambda v: (v["a"] + v["b"]) % 2**16 > 40000,
        (("a", "int32", 45000, 0, 1000), ("b", "int32", 100, 0, 1000)),
        ("(a + b) % 2**16 > 40000",),
    ),
    Shape(
        "int16 of a difference of int64",
        lambda v: signed(v["a"] - v["b"], 16) < -1000,
        (("a", "int64", 0, 0, 500), ("b", "int64", 20000, 0, 500)),
        ("int16(a - b) < -1000",),
    ),
    Shape(
        "divided by what is truncated to 0",
        lambda v: math.isfinite(v["x"]) and int(v["x"]) == 0,
        (("x", "float64", 0.25, 2.0, 90.0),),
        ("abs(x) < 1", "x < 1 and x > -1"),
    ),
    # -- strings ------------------------------------------------------------------------------------------------------
    Shape(
        "non-ASCII",
        lambda v: not v["s"].isascii(),
        (("s", "string", "é", ("map", "base", "odom"), 0),),
        ("not isascii(s)",),
    ),
    Shape(
        "longer than 255",
        lambda v: len(v["s"]) > 255,
        (("s", "string", "A" * 65536, ("map", "base", "odom"), 0),),
        ("len(s) > 255", "len(s) >= 256"),
    ),
    Shape(
        "empty",
        lambda v: v["s"] == "",
        (("s", "string", "", ("map", "base", "odom"), 0),),
        ('s == ""', "len(s) == 0"),
    ),
    Shape(
        "prefix",
        lambda v: v["s"].startswith("/"),
        (("s", "string", "/dev/null", ("map", "base", "odom"), 0),),
        ("startswith(s, '/')",),
    ),
    Shape(
        "long and on",
        lambda v: v["on"] and len(v["s"].encode()) > 64,
        (("s", "string", "A" * 256, ("map", "base", "odom"), 0), ("on", "bool", True, (False, True), 0)),
        ("on == True and bytes(s) > 64",),
    ),
    # -- categories, arrays, two messages -----------------------------------------------------------------------------
    Shape(
        "enum set",
        lambda v: v["mode"] in (2, 5, 7),
        (("mode", "uint8", 7, (0, 1, 3, 4), 0), ("x", "float64", 2.0, 0.0, 10.0)),
        ("mode in (2, 5, 7)",),
    ),
    Shape(
        "enum of powers of two",
        lambda v: v["gear"] not in (0, 1, 2, 4, 8),
        (("gear", "int64", -5, (0, 1, 2, 4), 0), ("rpm", "float64", 2.0, 0.0, 10.0)),
        ("gear not in (0, 1, 2, 4, 8)",),
        lambda chance: {"gear": chance.randrange(-2, 20), "rpm": chance.uniform(0, 10)},
    ),
    Shape(
        "enum with a gap",
        lambda v: v["state"] not in (0, 1, 2, 3, 5, 6) and v["on"],
        (("state", "int32", 4, (0, 1, 2, 3), 0), ("on", "bool", True, (False, True), 0)),
        ("on == True and state not in (0, 1, 2, 3, 5, 6)",),
        lambda chance: {"state": chance.randrange(-2, 10), "on": chance.random() < 0.7},
    ),
    Shape(
        "booleans and a range",
        lambda v: v["armed"] and not v["homed"] and -90 <= v["z"] < -5,
        (
            ("armed", "bool", True, (False, True), 0),
            ("homed", "bool", False, (False, True), 0),
            ("z", "float32", -10.0, 0.0, 5.0),
        ),
        ("armed == True and homed == False and z < -5 and z >= -90",),
    ),
    Shape(
        "data[i], i>=n of a message before",
        lambda v: v["/cmd:id"] >= v["/config:len(table)"],
        (("/cmd:id", "uint8", 255, 0, 3), ("/config:len(table)", "uint16", 8, (4, 8, 16), 0)),
        ("/cmd:id >= /config:len(table)",),
    ),
    # -- elements of arrays ------------------------------------------------------------------------------------------
    Shape(
        "any element is NaN",
        lambda v: any(math.isnan(one) for one in v["ranges[*]"]),
        (("ranges[*]", "float32[]", (math.nan, 7), 0.1, 30.0),),
        ("any(ranges[*]) is NaN",),
    ),
    Shape(
        "any element > 100",
        lambda v: any(one > 100 for one in v["poses[*].x"]),
        (("poses[*].x", "float64[]", (1e6, 3), -20.0, 20.0), ("mode", "int32", 2, 0, 4)),
        ("any(poses[*].x) > 100",),
    ),
    Shape(
        "all elements below 0, and a mode",
        lambda v: max(v["steps[*]"]) < 0 and v["mode"] == 2,
        (("steps[*]", "int16[]", (-300, range(12)), -5, 40), ("mode", "uint8", 2, 0, 4)),
        ("mode == 2 and all(steps[*]) < 0",),
    ),
    Shape(
        "elements further apart than 50",
        lambda v: max(v["cells[*]"]) - min(v["cells[*]"]) > 50,
        (("cells[*]", "int32[]", (1000, 2), 3300, 3310),),
        ("max(cells[*]) - min(cells[*]) > 50", "min(cells[*]) < max(cells[*]) - 50"),
    ),
    Shape(
        "any element beside a limit of its own",
        lambda v: any(one > v["limit"] for one in v["speeds[*]"]),
        (("speeds[*]", "float64[]", (1e6, 5), 0.0, 3.0), ("limit", "float64", 4.0, 4.0, 8.0)),
        ("max(speeds[*]) > limit",),
    ),
    Shape(
        "the first element, not the others",
        lambda v: v["ranges[*]"][0] < 0,
        (("ranges[*]", "float32[]", (-1.0, 0), 0.1, 30.0),),
        ("ranges[0] < 0",),
    ),
    # -- two messages -------------------------------------------------------------------------------------------------
    Shape(
        "jump from the previous message",
        lambda v: v["x"] - v["previous x"] > 5,
        (("x", "float64", 1e6, -2.0, 2.0), ("previous x", "float64", 0.5, -2.0, 2.0)),
        ("x - previous x > 5",),
    ),
    Shape(
        "jump either way from the previous message",
        lambda v: abs(v["x"] - v["previous x"]) > 100,
        (("x", "int16", 32767, -40, 40), ("previous x", "int16", 7, -40, 40)),
        ("x - previous x < -100 or x - previous x > 100",),
    ),
    Shape(
        "sequence number not above the previous one",
        lambda v: v["seq"] <= v["previous seq"],
        (("previous seq", "uint32", 41, 0, 300), ("seq", "uint32", 0, 0, 300)),
        ("seq <= previous seq", "previous seq >= seq"),
    ),
    Shape(
        "sequence number repeated",
        lambda v: v["seq"] == v["previous seq"],
        (("previous seq", "uint32", 41, 0, 300), ("seq", "uint32", 41, 0, 300)),
        ("seq == previous seq", "previous seq == seq"),
        lambda chance: (lambda n: {"seq": n, "previous seq": n})(
            chance.choice((0, 1, 2**31, chance.randint(0, 2**32 - 1)))
        ),
    ),
    Shape(
        "time stamp falls",
        lambda v: v["t"] < v["previous t"],
        (
            ("previous t", "float64", 1700000000.25, 1700000000.0, 1700000300.0),
            ("t", "float64", 0.0, 1700000000.0, 1700000300.0),
        ),
        ("t < previous t", "previous t > t"),
    ),
    Shape(
        "one message before the other",
        lambda v: v["/arm before /config"],
        (("/arm before /config", "bool", True, (False, True), 0),),
        ("/arm before /config",),
    ),
    Shape(
        "one message before the other, and a value",
        lambda v: v["/arm before /config"] and v["/config:rate"] > 1000,
        (("/arm before /config", "bool", True, (False, True), 0), ("/config:rate", "float64", 1e6, 1.0, 50.0)),
        ("/arm before /config and /config:rate > 1000", "/config:rate > 1000 and /arm before /config"),
    ),
    Shape(
        "order of two messages",
        lambda v: v["/goal:time"] < v["/map:time"],
        (("/goal:time", "float64", 1.0, 5.0, 20.0), ("/map:time", "float64", 4.0, 0.5, 4.5)),
        ("/goal:time < /map:time",),
    ),
)


@cache
def _shipped(type_: str) -> tuple[Scalar, ...]:
    values = (entry.value for entry in load_dictionary([]).values_for(type_, f"/topic:{type_}"))
    return tuple(value for value in values if not isinstance(value, str) or len(value) < 2**20)


def variables_of(shape: Shape, seed: int) -> list[Variable]:
    """Return the variables with twenty nominal values drawn by a seed."""
    chance = random.Random(seed + 1)
    found = []
    for name, type_, failing, low, high in shape.variables:
        nominal: tuple[Setting, ...]
        if type_.endswith("[]"):
            found.append(_array(name, type_, failing, low, high, chance))
            continue
        if isinstance(low, tuple):
            nominal = tuple(chance.choice(low) for _ in range(20)) + low
        elif type_.startswith("float"):
            nominal = tuple(round(chance.uniform(low, high), 3) for _ in range(20))
        else:
            nominal = tuple(chance.randint(low, high) for _ in range(20))
        dictionary: tuple[Scalar, ...] = ()
        if shape not in SHAPES[:FIRST]:
            dictionary = _shipped(type_)
        elif type_.startswith("float"):
            dictionary = (0.0, -1.0, 1.0, 1e-9, 1e6, -1e6, math.nan, math.inf, -math.inf, 1e300, -1e300)
        elif type_.startswith("int"):
            dictionary = (0, 1, -1, 100, 65535, INT_MAX, -INT_MAX - 1)
        elif type_.startswith("uint"):
            dictionary = (0, 1, 100, 65535, INT_MAX, 2 * INT_MAX + 1)
        found.append(Variable(name, type_, failing, nominal[:1], nominal, dictionary))
    return found


def _array(name: str, type_: str, failing: Any, low: float, high: float, chance: random.Random) -> Variable:
    """Return an array whose failing value is (element, where) or (element, all places)."""
    draw = chance.uniform if type_.startswith("float") else chance.randint
    nominal = [[draw(low, high) for _ in range(SIZE)] for _ in range(20)]  # type: ignore[arg-type]
    value, place = failing
    where = tuple(place) if isinstance(place, range) else (place,)
    bad = [value if number in where else one for number, one in enumerate(nominal[0])]
    arrays = tuple(map(Elements, nominal))
    return Variable(name, type_, Elements(bad), arrays[:1], arrays, _shipped(type_[:-2]), places=where[:1])


def held_out(shape: Shape, variables: Sequence[Variable], chance: random.Random) -> dict[str, Setting]:
    """Draw a case; on purpose not with the sampler that the learner uses.

    A fourth by `also` of the shape, if it has one. Else each field, independently: a third in the nominal range, a
    third of the dictionary, a third log-uniform over the type. Texts: a third nominal, a third of the dictionary, a
    third random ones of log-uniform length up to 2,000 out of one of four alphabets, half of these behind the begin of
    a known one.
    """
    if shape.also is not None and chance.random() < 0.25:
        return shape.also(chance)
    return {variable.name: _field(variable, chance) for variable in variables}


def _field(variable: Variable, chance: random.Random) -> Any:
    if variable.columns:
        return _elements(variable, chance)
    kind, sign = chance.randrange(3), chance.choice((-1, 1))
    limits = integer_range(variable.type)
    if variable.type == "string" and kind and variable.dictionary:
        return chance.choice(variable.dictionary) if kind == 1 else _text(variable, chance)
    if kind == 0 or variable.type in ("string", "bool", "bytes"):
        low, high = chance.choice(variable.nominal), chance.choice(variable.nominal)
        numbers = isinstance(low, int | float) and isinstance(high, int | float)
        numbers = numbers and variable.type != "bool"
        value: Any = low + (high - low) * chance.random() if numbers else low  # type: ignore[operator]
        return round(value) if limits and isinstance(value, float) else value
    if kind == 1:
        return chance.choice(variable.dictionary)
    if limits:
        size = int(2 ** (chance.random() * limits[1].bit_length()))
        return max(limits[0], min(limits[1], sign * size if limits[0] else size))
    top = 38 if variable.type == "float32" else 300
    number = sign * 10 ** chance.uniform(-top, top) if chance.random() < 0.5 else sign * 10 ** chance.uniform(-2, 6)
    held = fit(number, variable.type)
    return number if held is None else held


def _elements(variable: Variable, chance: random.Random) -> Elements:
    """Draw an array: nominal, with one element, some or all of them as `held_out` draws a field."""
    base = chance.choice(variable.nominal)
    assert isinstance(base, Elements)
    values = tuple(one for array in variable.nominal if isinstance(array, Elements) for one in array)
    element = Variable(variable.name, variable.type[:-2], values[0], nominal=values, dictionary=variable.dictionary)
    count = chance.choice((0, 1, 1, 2, 5, len(base), len(base)))
    places = set(chance.sample(range(len(base)), count))
    alike = chance.random() < 0.5
    drawn = [_field(element, chance) for _ in base]
    return Elements(
        drawn[0 if alike else at] if at in places else one  # type: ignore[misc]
        for at, one in enumerate(base)
    )


_ALPHABETS = ("abcxyz", "ABC/_-.09 ", "0123456789", "abcé日ü")


def _text(variable: Variable, chance: random.Random) -> str:
    size = int(2 ** chance.uniform(0, 11)) - 1
    text = "".join(chance.choice(chance.choice(_ALPHABETS)) for _ in range(size))
    known = str(chance.choice((*variable.nominal, *variable.dictionary)))
    return known[: chance.randint(0, 8)] + text if chance.random() < 0.5 else text


def near_limits(shape: Shape, variables: Sequence[Variable], chance: random.Random, count: int) -> list[Values]:
    """Return cases at and near the true limits.

    Between a failing and a passing case of `held_out`, the field at which the outcome flips is bisected until two
    neighbouring numbers fail and pass: both, and a number at a log-uniform relative distance of 1e-6 to 0.5 from them.
    """
    types = {variable.name: variable.type.removesuffix("[]") for variable in variables}
    cases: dict[bool, list[dict[str, Any]]] = {True: [], False: []}
    for _ in range(20 * count):
        drawn = held_out(shape, variables, chance)
        cases[bool(shape.fails(drawn))].append(drawn)
    found: list[Values] = []
    for _ in range(4 * count if all(cases.values()) else 0):
        if len(found) >= count:
            break
        failing, passing = dict(chance.choice(cases[True])), chance.choice(cases[False])
        slots = [slot for name in sorted(failing) for slot in _slots(name, failing[name])]
        for slot in chance.sample(slots, len(slots)):
            before = failing
            failing = _put(failing, slot, _get(passing, slot))
            if not shape.fails(failing):
                found += _beside(shape, before, slot, types[slot[0]], _get(passing, slot), chance)
                break
    return found


Slot = tuple[str, int | None]
"""A field, or one element of an array."""


def _slots(name: str, value: Any) -> list[Slot]:
    return [(name, place) for place in range(len(value))] if isinstance(value, Elements) else [(name, None)]


def _get(case: Values, slot: Slot) -> Any:
    name, place = slot
    return case[name] if place is None else case[name][place]


def _put(case: Values, slot: Slot, value: Any) -> dict[str, Any]:
    name, place = slot
    whole = value if place is None else Elements((*case[name][:place], value, *case[name][place + 1 :]))
    return {**case, name: whole}


def _beside(shape: Shape, case: Values, slot: Slot, type_: str, passing: Scalar, chance: random.Random) -> list[Values]:
    bad, good = _get(case, slot), passing
    if not isinstance(bad, int | float) or not isinstance(good, int | float) or type_ == "bool":
        return []
    if not (math.isfinite(bad) and math.isfinite(good)):
        return []
    while True:
        middle = between(min(bad, good), max(bad, good))  # type: ignore[type-var, arg-type]
        middle = None if middle is None else fit(middle, type_)  # type: ignore[assignment]
        if middle is None or middle in (bad, good):
            break
        if shape.fails(_put(case, slot, middle)):
            bad = middle
        else:
            good = middle
    assert isinstance(bad, int | float)
    away = bad * (1 + chance.choice((-1, 1)) * 10 ** chance.uniform(-6, -0.3))
    further = [fit(round(away) if isinstance(bad, int) else away, type_), fit(step(bad, 1), type_)]
    return [_put(case, slot, value) for value in (bad, good, *further) if value is not None]


def canonical(text: str) -> frozenset[frozenset[str]]:
    """Return the terms and literals of a rule's text without their order."""
    terms = [
        term[1:-1] if " and " in term and term.startswith("(") and term.endswith(")") else term
        for term in text.split(" or ")
    ]
    return frozenset(frozenset(term.split(" and ")) for term in terms)
