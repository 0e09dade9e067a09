import math

import pytest

from riot_bus.generalize.sampling import fit


@pytest.mark.parametrize("type_", ["int64", "uint64", "float32", "float64"])
def test_an_integer_that_a_type_cannot_hold_does_not_fit(type_: str) -> None:
    assert fit(10**400, type_) is None
    assert fit(-(10**400), type_) is None


def test_a_value_fits_as_its_type_holds_it() -> None:
    assert fit(2.9, "int8") == 2
    assert fit(True, "uint8") == 1
    assert fit(0.1, "float32") == pytest.approx(0.1, abs=1e-8)
    assert fit(0.1, "float32") != 0.1
    assert fit(math.inf, "float32") == math.inf
    assert fit("a", "string") == "a"
    assert fit("a", "bytes") is None
    assert fit(1, "bool") is None
