from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus_fleet.agent.proof import is_proved, new_secret, prove, proved

SECRET = new_secret()
_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text().filter(lambda name: name != "proof"), _JSON, max_size=4), st.text(max_size=20))
def test_what_is_proved_is_believed_with_its_secret_and_nonce_alone(document: dict[str, Any], nonce: str) -> None:
    said = proved(document, SECRET, nonce)
    assert {name: value for name, value in said.items() if name != "proof"} == document
    assert is_proved(said, SECRET, nonce)
    assert not is_proved(said, new_secret(), nonce)
    assert not is_proved(said, SECRET, f"{nonce}0")
    assert not is_proved({**said, "more": 1}, SECRET, nonce)
    assert not is_proved(document, SECRET, nonce)


def test_without_a_secret_nothing_is_proved() -> None:
    assert proved({"a": 1}, None, "7") == {"a": 1}


@pytest.mark.parametrize("proof", [None, 3, [], {}, {"code": 3}, {"code": "é"}, {"code": None, "nonce": "1"}])
def test_strange_proofs_are_none(proof: object) -> None:
    assert not is_proved({"proof": proof}, SECRET, "1")


def test_a_proof_cannot_be_sent_back_by_the_other_role() -> None:
    assert prove(SECRET, "agent", "1") != prove(SECRET, "controller", "1")


def test_secrets_are_fresh_and_long() -> None:
    assert len({new_secret() for _ in range(100)}) == 100
    assert all(len(new_secret()) == 32 for _ in range(3))
