from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.types.model import (
    MOST_BYTES,
    MOST_LEAVES,
    check_leaves,
    check_size,
    encoded_text,
    member_path,
    packed_float,
    parse_path,
    rebuilt,
    saturated,
    wanted_length,
    why_opaque,
    wrap_integer,
)
from riot_bus.vocabulary.errors import PayloadError


@pytest.mark.parametrize(
    ("path", "steps", "length"),
    [
        ("pose.position.x", ("pose", "position", "x"), False),
        ("ranges[3]", ("ranges", 3), False),
        ("[0][-1].x", (0, -1, "x"), False),
        ("len(ranges)", ("ranges",), True),
        ('["odd key"].x', ("odd key", "x"), False),
        (r'a["\"]\n"][2]', ("a", '"]\n', 2), False),
        ("len", ("len",), False),
    ],
)
def test_paths(path: str, steps: tuple[str | int, ...], *, length: bool) -> None:
    assert (parse_path(path).steps, parse_path(path).length) == (steps, length)


@pytest.mark.parametrize("path", ["", "len()", "x.", "x..y", "x[", "x[y]", "x[1", "x y", r'["\x"]', "x[1]y", "é"])
def test_what_is_no_path(path: str) -> None:
    with pytest.raises(PayloadError):
        parse_path(path)


@pytest.mark.parametrize("steps", [("a", "b"), ("a b", 3, 'q"\\'), ("", "é"), (0, "x"), ("len(x)",), ("a[*]",), ("*",)])
def test_the_path_of_any_member_leads_to_it(steps: tuple[str | int, ...]) -> None:
    path = ""
    for step in steps:
        path = member_path(path, step)
    assert parse_path(path).steps == steps


def test_paths_cannot_grow_without_end() -> None:
    assert len(member_path("a", "b" * 1024)) == 1026
    for parent, key in (("a" * 1025, "b"), ("a", "b" * 1025), ("a" * 1025, 3)):
        with pytest.raises(PayloadError, match="more than 1024 characters"):
            member_path(parent, key)


@pytest.mark.parametrize(
    ("value", "unsigned", "signed"), [(255, 255, -1), (256, 0, 0), (-1, 255, -1), (128, 128, -128), (127, 127, 127)]
)
def test_integers_wrap_as_in_c(value: int, unsigned: int, signed: int) -> None:
    assert wrap_integer(value, bits=8, signed=False) == unsigned
    assert wrap_integer(value, bits=8, signed=True) == signed


def test_numbers_that_overflow_become_infinite() -> None:
    assert (saturated(10**400), saturated(-(10**400)), saturated(3)) == (math.inf, -math.inf, 3.0)
    assert packed_float("<f", 1e300) == packed_float("<f", math.inf) == b"\x00\x00\x80\x7f"
    assert packed_float("<f", -1e300) == packed_float("<f", -(10**400)) == b"\x00\x00\x80\xff"


def test_bytes_that_are_no_text_survive_as_text() -> None:
    raw = "é".encode() + b"\xff"
    assert encoded_text(raw.decode(errors="surrogateescape")) == raw
    with pytest.raises(PayloadError, match="cannot be encoded"):
        encoded_text("\ud800")


@pytest.mark.parametrize("value", [-1, 1 << 32, 1.0, "3", True, b"\3"])
def test_what_is_no_length(value: Any) -> None:
    assert wanted_length((1 << 32) - 1, "x") == (1 << 32) - 1
    with pytest.raises(PayloadError, match="is not a length"):
        wanted_length(value, "x")


def test_lengths_change_before_what_is_inside() -> None:
    calls: list[Any] = []

    def resize(payload: bytes, path: str, count: int) -> bytes:
        calls.append((path, count))
        return payload + b"r"

    def patch(payload: bytes, changes: Any) -> bytes:
        calls.append(dict(changes))
        return payload + b"p"

    assert rebuilt(b"", {"a[7]": 1, "len(a)": 8, "b": 2}, resize, patch) == b"rp"
    assert calls == [("len(a)", 8), {"a[7]": 1, "b": 2}]
    assert rebuilt(b"", {"len(a)": 8}, resize, patch) == b"r"


def test_work_is_bounded() -> None:
    check_size(MOST_BYTES)
    check_leaves(MOST_LEAVES, 16)
    check_leaves(4 * MOST_LEAVES, MOST_LEAVES)  # whoever wants so many elements gets them
    with pytest.raises(PayloadError, match="over the limit"):
        check_size(MOST_BYTES + 1)
    with pytest.raises(PayloadError, match="more than"):
        check_leaves(MOST_LEAVES + 1, 16)


def test_the_reason_why_a_payload_is_opaque_is_that_of_the_listing() -> None:
    def leaves(payload: bytes) -> list[Any]:
        if payload:
            raise PayloadError("too long", where="x")
        return []

    kind: Any = SimpleNamespace(leaves=leaves)
    assert (why_opaque(kind, b""), why_opaque(kind, b"x")) == (None, "too long")
