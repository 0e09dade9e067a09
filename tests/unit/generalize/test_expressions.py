import math
from typing import Any

import numpy as np
import pytest

from riot_bus.generalize.expressions import Applied, Name, Node, evaluate, text

X, Y, S = Name("x"), Name("y"), Name("s")


def value(node: Node, **row: Any) -> Any:
    found = evaluate(node, lambda name: np.array([row[name]], dtype=object))
    return None if found is None else np.broadcast_to(found, (1,)).tolist()[0]


@pytest.mark.parametrize(
    ("node", "row", "result"),
    [
        (Applied("mul", (Applied("mul", (X, X)), X)), {"x": 2**40}, 2**120),
        (Applied("mod", (Applied("sub", (X, Y)), 2**32)), {"x": 1, "y": 2}, 2**32 - 1),
        (Applied("signed", (Applied("add", (X, Y)), 32)), {"x": 2**31 - 1, "y": 1}, -(2**31)),
        (Applied("signed", (Applied("add", (X, Y)), 64)), {"x": 2**63 - 1, "y": 1}, -(2**63)),
        (Applied("and", (X, 8)), {"x": 12}, 8),
        (Applied("and", (X, 2**63)), {"x": 2**64 - 1}, 2**63),
        (Applied("add", (Applied("mul", (0.5, X)), Y)), {"x": 3, "y": 1}, 2.5),
        (Applied("max", (X, Y)), {"x": 2.5, "y": 3}, 3.0),
        (Applied("len", (S,)), {"s": "é日"}, 2),
        (Applied("bytes", (S,)), {"s": "é日"}, 5),
        (Applied("bytes", (S,)), {"s": "\ud800"}, 3),
        (Applied("isascii", (S,)), {"s": "é"}, 0.0),
        (Applied("isutf8", (S,)), {"s": b"\xff"}, 0.0),
        (Applied("isutf8", (S,)), {"s": "é".encode()}, 1.0),
        (Applied("isprintable", (S,)), {"s": "a\x07"}, 0.0),
        (Applied("startswith", (S, "ab")), {"s": "abc"}, 1.0),
        (Applied("contains", (S, b"\0")), {"s": b"a\0"}, 1.0),
        (Applied("not", (Applied("isfinite", (X,)),)), {"x": math.inf}, True),
    ],
)
def test_values_are_exact(node: Node, row: dict[str, Any], result: Any) -> None:
    assert value(node, **row) == result
    assert text(node)


def test_rows_without_a_text_have_no_flag_and_columns_of_numbers_no_length() -> None:
    mixed = np.array(["a", 1, b"a"], dtype=object)
    found = evaluate(Applied("startswith", (S, "a")), lambda _: mixed)
    assert found is not None
    assert found[0] == 1.0
    assert np.isnan(found[1:]).all()
    assert evaluate(Applied("len", (S,)), lambda _: np.array([1.0])) is None
    assert evaluate(Applied("add", (X, 1)), lambda _: mixed) is None


def test_texts_have_the_parentheses_that_they_need() -> None:
    assert text(Applied("sub", (X, Applied("add", (Y, 1))))) == "x - (y + 1)"
    assert text(Applied("mul", (Applied("add", (X, Y)), 2))) == "(x + y) * 2"
    assert text(Applied("mod", (Applied("mul", (X, Y)), 2**32))) == "(x * y) % 2**32"
    assert text(Applied("and", (X, 8))) == "(x & 8)"
    assert text(Applied("signed", (Applied("add", (X, Y)), 16))) == "int16(x + y)"
    assert text(Applied("div", (X, Applied("mul", (X, Y))))) == "x / (x * y)"
    assert text(Applied("add", (X, Applied("add", (Y, 1))))) == "x + y + 1"
