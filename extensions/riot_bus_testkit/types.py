"""Conformance tests for message types, for authors of codecs to inherit.

    class TestMine(TypeConformance):
        kind = MyType()
        payloads = (b"...", b"...")

Needs pytest and Hypothesis: the extra `testing`.
"""

from __future__ import annotations

import math
import re
import struct
import sys
import tracemalloc
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from riot_bus.types.capabilities import DescribesFields
from riot_bus.types.fields import of_numbers
from riot_bus.types.model import REBUILD, Leaf, MessageType
from riot_bus.types.payloads import Payloads
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Scalar

_ELEMENTS = 50  # short arrays are listed whole, and long ones do not slow down each of many examples
_INTEGERS = {f"{sign}int{bits}": (bits, not sign) for sign in ("", "u") for bits in (8, 16, 32, 64)}
_PYTHON = {"bool": bool, "string": str, "bytes": bytes, "float32": float, "float64": float}
SETTINGS = settings(
    deadline=None,
    suppress_health_check=[HealthCheck.differing_executors, HealthCheck.too_slow, HealthCheck.filter_too_much],
)


class HostileConformance:
    """Tests with arbitrary bytes: nothing but `PayloadError` is raised, and work and memory are bounded.

    Attributes:
        kind: The message type.
        payloads: Some of its payloads, from which hostile ones are made.
        lines: Largest number of Python lines executed for a payload, and in addition for each of its bytes.
        memory: Largest memory for a payload in bytes, and 1024 more for each of its bytes.
    """

    kind: ClassVar[MessageType]
    payloads: ClassVar[Sequence[bytes]]
    lines: ClassVar[int] = 5_000
    memory: ClassVar[int] = 1 << 22

    def test_it_is_a_message_type(self) -> None:
        """The protocol is complete."""
        assert isinstance(self.kind, MessageType)
        assert self.kind.name
        assert isinstance(self.kind.encoding, str)

    @SETTINGS
    @given(data=st.data())
    def test_hostile_bytes(self, data: st.DataObject) -> None:
        """Broken samples and random bytes are read or rejected with PayloadError."""
        payload = data.draw(hostile(self.payloads))
        self._exercise(payload, data.draw(st.sampled_from(self._paths())))

    @SETTINGS
    @given(data=st.data())
    def test_opaque_agrees_with_leaves(self, data: st.DataObject) -> None:
        """`opaque` returns the message of the error that `leaves` raises, and raises nothing."""
        payload = data.draw(hostile(self.payloads))
        raised = None
        try:
            self.kind.leaves(payload)
        except PayloadError as error:
            raised = error.message
        assert raised != ""
        assert self.kind.opaque(payload) == raised

    @SETTINGS
    @given(data=st.data())
    def test_any_path(self, data: st.DataObject) -> None:
        """Any text given as a path is read or rejected with PayloadError."""
        steps = st.from_regex(r"(\[[0-9]{1,3}\]|\.[a-z]|\[-1\]|\[\"){0,3}", fullmatch=True)
        path = data.draw(st.text(max_size=12) | st.sampled_from(self._paths())) + data.draw(steps)
        self._exercise(data.draw(st.sampled_from(self.payloads)), path)

    def test_memory_is_bounded(self) -> None:
        """False counts in a payload do not make it allocate memory."""
        for payload in self.payloads:
            for at in range(min(len(payload), 64)):
                for filler in (b"\xff" * 4, b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\xff" * 9 + b"\x01"):
                    broken = payload[:at] + filler + payload[at + len(filler) :]
                    tracemalloc.start()
                    try:
                        self.kind.opaque(broken)
                        taken = tracemalloc.get_traced_memory()[1]
                    finally:
                        tracemalloc.stop()
                    assert taken <= self.memory + 1024 * len(broken), f"{taken} bytes of memory for {broken!r}"

    def _exercise(self, payload: bytes, path: str) -> None:
        kind = self.kind
        acts: list[Callable[[], object]] = [
            lambda: kind.leaves(payload),
            lambda: kind.leaves(payload, elements=0),
            lambda: kind.opaque(payload),
            lambda: kind.read(payload, path),
            lambda: kind.read(payload, f"len({path})"),
            lambda: kind.patch(payload, {path: 1}),
            lambda: kind.patch(payload, {path: "text"}),
            lambda: kind.rebuild(payload, {path: math.nan}),
            lambda: kind.rebuild(payload, {f"len({path})": 3}),
        ]
        for act in acts:
            try:
                _bounded(act, self.lines * (1 + len(payload)))
            except PayloadError:
                continue

    def _paths(self) -> list[str]:
        found = ["value", "value[0]", "a"]
        for payload in self.payloads:
            try:
                found += [leaf.path for leaf in self.kind.leaves(payload)]
            except PayloadError:
                continue
        return sorted({path.removeprefix("len(").removesuffix(")") for path in found})


class TypeConformance(HostileConformance):
    """Tests of a type whose payloads can be decoded into fields.

    Attributes:
        widest: Largest size of a number in bytes: the longest is in JSON, 24; types with checksums set more.
    """

    widest: ClassVar[int] = 64

    def test_samples_have_fields(self) -> None:
        """No sample is opaque, and at least one has fields."""
        for payload in self.payloads:
            assert self.kind.opaque(payload) is None
        assert any(self.kind.leaves(payload) for payload in self.payloads)

    def test_what_is_listed_is_read(self) -> None:
        """Each field is listed once, has a value of its type, and reads as the listed value."""
        for payload in self.payloads:
            leaves = self.kind.leaves(payload, elements=_ELEMENTS)
            assert len({leaf.path for leaf in leaves}) == len(leaves)
            for leaf in leaves:
                assert _is_of(leaf.type, leaf.value), leaf
                assert same(self.kind.read(payload, leaf.path), leaf.value), leaf

    def test_few_elements_are_listed(self) -> None:
        """`elements` limits the listed elements of arrays and nothing else."""
        for payload in self.payloads:
            every = [leaf.path for leaf in self.kind.leaves(payload, elements=_ELEMENTS)]
            for most in (0, 1, 2):
                few = [leaf.path for leaf in self.kind.leaves(payload, elements=most)]
                arrays = [path[len("len(") : -1] for path in few if path.startswith("len(")]
                assert few == [path for path in every if path in set(few)]
                assert arrays or few == every or isinstance(self.kind, DescribesFields)  # with arrays of fixed length
                indices = (_index_in(path, array) for array in arrays for path in few)
                assert all(index is None or index < most for index in indices)

    @SETTINGS
    @given(data=st.data())
    def test_patch_changes_one_field(self, data: st.DataObject) -> None:
        """A scalar is patched in place, or rejected with the advice to rebuild; nothing else changes."""
        payload, leaf = self._scalar(data)
        value = data.draw(values_of(leaf.type))
        rebuilt = self.kind.rebuild(payload, {leaf.path: value})
        patched = self._patched(payload, leaf.path, value)
        if patched is not None:
            assert patched == rebuilt
            self._check_span(payload, patched, leaf, value)
        self._check_change(payload, rebuilt, leaf, value)

    @SETTINGS
    @given(data=st.data(), value=st.integers(-(1 << 70), 1 << 70))
    def test_integers_wrap(self, data: st.DataObject, value: int) -> None:
        """Integers out of range are truncated to the bits of their field."""
        payload, leaf = self._scalar(data, *_INTEGERS)
        after = self.kind.read(self.kind.rebuild(payload, {leaf.path: value}), leaf.path)
        assert isinstance(after, int)
        assert (after - value) % (1 << _INTEGERS[leaf.type][0]) == 0

    @SETTINGS
    @given(data=st.data(), value=st.sampled_from([math.inf, -math.inf, math.nan, 1e300, 5e-324, -0.0, 10**400, 3]))
    def test_floats_saturate(self, data: st.DataObject, value: float) -> None:
        """Floats that overflow become infinite; NaN and infinity can be written."""
        payload, leaf = self._scalar(data, "float32", "float64")
        after = self.kind.read(self.kind.rebuild(payload, {leaf.path: value}), leaf.path)
        assert same(after, narrowed(value, leaf.type))

    @SETTINGS
    @given(data=st.data())
    def test_rebuild_sets_several(self, data: st.DataObject) -> None:
        """Several fields are set at once, whatever their sizes."""
        payload = data.draw(st.sampled_from(self.payloads))
        scalars = self._scalars(payload)
        assume(scalars)
        chosen = data.draw(st.lists(st.sampled_from(scalars), min_size=1, max_size=6, unique_by=lambda leaf: leaf.path))
        changes = {leaf.path: data.draw(values_of(leaf.type)) for leaf in chosen}
        rebuilt = self.kind.rebuild(payload, changes)
        for path, value in changes.items():
            assert same(self.kind.read(rebuilt, path), value)
        before = {leaf.path: leaf for leaf in self.kind.leaves(payload, elements=_ELEMENTS)}
        after = {leaf.path: leaf for leaf in self.kind.leaves(rebuilt, elements=_ELEMENTS)}
        assert list(before) == list(after)
        assert all(same_leaf(after[path], leaf) for path, leaf in before.items() if path not in changes)

    @SETTINGS
    @given(data=st.data())
    def test_lengths_change(self, data: st.DataObject) -> None:
        """Elements are cut from the end, or the last one is repeated there."""
        payload, path, count = self._array(data)
        wanted = data.draw(st.integers(0, count + 5))
        try:
            rebuilt = self.kind.rebuild(payload, {f"len({path})": wanted})
        except PayloadError:
            assert count == 0 < wanted
            return
        assert self.kind.read(rebuilt, f"len({path})") == wanted
        assert wanted != count or rebuilt == payload
        before = self.kind.leaves(payload, elements=_ELEMENTS)
        after = {leaf.path: leaf for leaf in self.kind.leaves(rebuilt, elements=_ELEMENTS)}
        for leaf in before:
            index = _index_in(leaf.path, path)
            if leaf.path != f"len({path})" and (index is None or index < wanted):
                assert same_leaf(after[leaf.path], leaf), leaf
            if count and index == count - 1:
                for number in range(count, min(wanted, _ELEMENTS)):
                    place = leaf.path.replace(f"{path}[{index}]", f"{path}[{number}]", 1)
                    assert same(after[place].value, leaf.value)
        assert all(_index_in(each, path) is None or (_index_in(each, path) or 0) < wanted for each in after)

    @SETTINGS
    @given(data=st.data())
    def test_lengths_come_before_elements(self, data: st.DataObject) -> None:
        """An element that a change of length adds can be set at once."""
        payload, path, count = self._array(data)
        leaves = self.kind.leaves(payload, elements=count)
        leaf = next((leaf for leaf in leaves if leaf.path == f"{path}[{count - 1}]"), None)
        assume(count and leaf is not None)
        assert leaf is not None
        value = data.draw(values_of(leaf.type))
        rebuilt = self.kind.rebuild(payload, {f"{path}[{count}]": value, f"len({path})": count + 1})
        assert same(self.kind.read(rebuilt, f"{path}[{count}]"), value)

    @pytest.mark.parametrize("length", [-1, True, 1.5, "3", b"3", 1 << 32, (1 << 32) - 1])
    def test_lengths_that_are_none(self, length: Scalar) -> None:
        """Invalid or far too large lengths are rejected, and a length is never patched in place."""
        for payload in self.payloads:
            for leaf in self.kind.leaves(payload):
                if leaf.path.startswith("len("):
                    with pytest.raises(PayloadError):
                        self.kind.rebuild(payload, {leaf.path: length})
                    with pytest.raises(PayloadError):
                        self.kind.patch(payload, {leaf.path: leaf.value})

    def test_nothing_to_change(self) -> None:
        """Without changes the payload stays the same, and writing the existing values keeps all fields."""
        for payload in self.payloads:
            assert self.kind.patch(payload, {}) == self.kind.rebuild(payload, {}) == payload
            for leaf in self._scalars(payload):
                after = self._patched(payload, leaf.path, leaf.value)
                before = self.kind.leaves(payload, elements=_ELEMENTS)
                assert after is None or all(map(same_leaf, self.kind.leaves(after, elements=_ELEMENTS), before))

    def test_fields_without_a_payload(self) -> None:
        """A type's description of its fields agrees with its payloads."""
        if not isinstance(self.kind, DescribesFields):
            pytest.skip("this type does not describe its fields")
        fields = {field.path: field for field in self.kind.fields()}
        assert fields
        assert all(each.low is None or each.high is None or each.low <= each.high for each in fields.values())
        for payload in self.payloads:
            for leaf in self.kind.leaves(payload, elements=_ELEMENTS):
                known = fields.get(re.sub(r"\[\d+\]", "[*]", leaf.path))
                assert known is None or known.type == leaf.type, leaf
        for field in fields.values():
            if of_numbers(field):
                self._check_elements(self.kind, field.path.removesuffix("[*]"))

    def _check_elements(self, kind: DescribesFields, path: str) -> None:
        for payload in self.payloads:
            try:
                count = int(self.kind.read(payload, f"len({path})"))
            except PayloadError:
                continue
            one = Payloads(payload, np.zeros(1, np.int64), np.full(1, len(payload), np.int64))
            found = np.concatenate([np.zeros(0), *(np.ravel(each) for each in kind.elements(one, path))])
            expected = [self.kind.read(payload, f"{path}[{index}]") for index in range(count)]
            assert np.array_equal(found, np.array(expected, np.float64), equal_nan=True)

    def _check_span(self, payload: bytes, patched: bytes, leaf: Leaf, value: Scalar) -> None:
        """Check that the differing bytes are no more than one field takes."""
        same_start = _common(payload, patched)
        rest = min(len(payload), len(patched)) - same_start
        same_end = _common(payload[::-1][:rest], patched[::-1][:rest])
        size = max(_size(leaf.value), _size(value), self.widest)
        assert max(len(payload), len(patched)) - same_start - same_end <= size

    def _check_change(self, payload: bytes, changed: bytes, leaf: Leaf, value: Scalar) -> None:
        assert same(self.kind.read(changed, leaf.path), value)
        before = [each for each in self.kind.leaves(payload, elements=_ELEMENTS) if each.path != leaf.path]
        after = [each for each in self.kind.leaves(changed, elements=_ELEMENTS) if each.path != leaf.path]
        assert len(before) == len(after)
        assert all(map(same_leaf, before, after))

    def _patched(self, payload: bytes, path: str, value: Scalar) -> bytes | None:
        """Return the patched payload, None if the type says that the value does not fit in place."""
        try:
            return self.kind.patch(payload, {path: value})
        except PayloadError as error:
            if error.hint != REBUILD:
                raise
            return None

    def _scalars(self, payload: bytes) -> list[Leaf]:
        leaves = self.kind.leaves(payload, elements=_ELEMENTS)
        return [leaf for leaf in leaves if not leaf.path.startswith("len(")]

    def _scalar(self, data: st.DataObject, *types: str) -> tuple[bytes, Leaf]:
        found = [(payload, leaf) for payload in self.payloads for leaf in self._scalars(payload)]
        found = [(payload, leaf) for payload, leaf in found if not types or leaf.type in types]
        if not found:
            pytest.skip("the samples have no field of such a type")
        return data.draw(st.sampled_from(found))

    def _array(self, data: st.DataObject) -> tuple[bytes, str, int]:
        found = [
            (payload, leaf.path[len("len(") : -1], leaf.value)
            for payload in self.payloads
            for leaf in self.kind.leaves(payload)
            if leaf.path.startswith("len(") and isinstance(leaf.value, int)
        ]
        if not found:
            pytest.skip("the samples have no sequences")
        return data.draw(st.sampled_from(found))


@st.composite
def hostile(draw: st.DrawFn, payloads: Sequence[bytes]) -> bytes:
    """Return random bytes, or a sample that was cut, extended, overwritten or spliced with another."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=120))
    payload = draw(st.sampled_from(payloads))
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, len(payload)))
        end = draw(st.integers(at, min(len(payload), at + 8)))
        other = draw(st.sampled_from(payloads))
        start = draw(st.integers(0, len(other)))
        payload = draw(
            st.sampled_from(
                [
                    payload[:at],
                    payload[at:],
                    payload[:at] + draw(st.binary(max_size=9)) + payload[end:],
                    payload[:at] + b"\xff" * (end - at) + payload[end:],
                    payload[:at] + other[start : start + 40] + payload[at:],
                ]
            )
        )
    return payload


def values_of(kind: str) -> st.SearchStrategy[Any]:
    """Return a strategy for the values of a type, named as in `Leaf`."""
    if kind in _INTEGERS:
        bits, signed = _INTEGERS[kind]
        return st.integers(-(1 << (bits - 1)) if signed else 0, (1 << (bits - signed)) - 1)
    strategies: dict[str, st.SearchStrategy[Any]] = {
        "bool": st.booleans(),
        "float32": st.floats(width=32),
        "float64": st.floats(),
        "string": st.text(st.characters(min_codepoint=1, exclude_categories=["Cs"]), max_size=20),
        "bytes": st.binary(max_size=20),
    }
    return strategies[kind]


def same(one: Scalar, other: Scalar) -> bool:
    """Return whether values are equal; NaN is equal to NaN, and 1 is not True."""
    if isinstance(one, float) and isinstance(other, int | float) and math.isnan(one):
        return math.isnan(other)
    return one == other and isinstance(one, bool) == isinstance(other, bool)


def same_leaf(one: Leaf, other: Leaf) -> bool:
    """Return whether fields are the same, and have the same values."""
    return (one.path, one.type) == (other.path, other.type) and same(one.value, other.value)


def narrowed(value: float, kind: str) -> float:
    """Return a number as it is stored in a field of type float32 or float64."""
    form = "<f" if kind == "float32" else "<d"
    try:
        return float(struct.unpack(form, struct.pack(form, float(value)))[0])
    except OverflowError:
        return math.copysign(math.inf, 1 if value > 0 else -1)


def _is_of(kind: str, value: Scalar) -> bool:
    if kind in _INTEGERS:
        bits, signed = _INTEGERS[kind]
        low, high = (-(1 << (bits - 1)), 1 << (bits - 1)) if signed else (0, 1 << bits)
        return type(value) is int and low <= value < high
    return type(value) is _PYTHON[kind]


def _index_in(path: str, array: str) -> int | None:
    """Return the index of the array element that contains a path, None if no element does."""
    rest = path.removeprefix("len(")
    match = re.match(r"\[(\d+)\]", rest[len(array) :]) if rest.startswith(array) else None
    return int(match.group(1)) if match is not None else None


def _common(one: bytes, other: bytes) -> int:
    """Return the length of the common prefix."""
    pairs = zip(one, other, strict=False)
    return next((at for at, (left, right) in enumerate(pairs) if left != right), min(len(one), len(other)))


def _size(value: Scalar) -> int:
    """Return the largest encoded size of a string or bytes, with its delimiters; 0 for other values."""
    if isinstance(value, str):
        return 16 + 12 * len(value)
    return 16 + len(value) if isinstance(value, bytes) else 0


def _bounded(act: Callable[[], object], most: int) -> object:
    """Call a function; raise an error if it executes more than `most` lines of Python."""
    left = most

    def count(frame: FrameType, event: str, arg: Any) -> Any:
        nonlocal left
        del frame, arg
        if event == "line":
            left -= 1
            if left < 0:
                raise AssertionError(f"more than {most} lines of Python were executed")
        return count

    before = sys.gettrace()
    sys.settrace(count)
    try:
        return act()
    finally:
        sys.settrace(before)
