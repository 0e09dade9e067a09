"""One field of many payloads: read in bulk if the type supports that, otherwise one payload at a time."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from riot_bus.types.capabilities import GathersFields
from riot_bus.types.model import MessageType
from riot_bus.types.payloads import Gathered, Payloads
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Scalar

_EXACT = 1 << 53  # beyond it, float64 skips integers


def gather(kind: MessageType, payloads: Payloads, path: str) -> Gathered:
    """Return one field of many payloads; payloads that cannot be decoded, or lack the field, are marked as not valid.

    Raises:
        PayloadError: The type has no such field, whatever the payload.
    """
    if not _has_bulk(type(kind)):
        return as_array([_read(kind, payload, path) for payload in payloads])
    found = cast("GathersFields", kind).gather(payloads, path)
    if found.doubtful is None or not found.doubtful.any():
        return Gathered(found.values, found.valid)
    rows = np.flatnonzero(found.doubtful)
    for row, payload in zip(rows.tolist(), payloads.take(rows), strict=True):
        value = _read(kind, payload, path)
        if value is not None:
            found.values[row] = value
            found.valid[row] = True
    return Gathered(found.values, found.valid)


@lru_cache(maxsize=256)
def _has_bulk(kind: type[MessageType]) -> bool:
    return issubclass(kind, GathersFields)  # takes 40 us, hence the cache


def as_array(values: list[Scalar | None]) -> Gathered:
    """Return scalars as an array of the narrowest type that holds all of them exactly; None marks a missing value.

    The types are bool, int64, uint64, float64 and object (text, bytes, mixtures); without any value, float64.
    """
    valid = np.array([value is not None for value in values], np.bool_)
    kinds = {type(value) for value in values if value is not None}
    dtype = _dtype(kinds, values)
    if dtype == np.object_:
        objects = np.empty(len(values), np.object_)  # numpy would make arrays of sequences, such as bytes
        objects[:] = values
        return Gathered(objects, valid)
    nothing: float = np.nan if dtype == np.float64 else 0
    return Gathered(np.array([nothing if value is None else value for value in values], dtype), valid)


def join(parts: list[Gathered]) -> Gathered:
    """Concatenate arrays of one field into one array whose type holds all values exactly."""
    valid = np.concatenate([part.valid for part in parts]) if parts else np.zeros(0, np.bool_)
    arrays = [part.values for part in parts if part.valid.any()] or [part.values for part in parts]
    dtypes = {array.dtype for array in arrays}
    if len(dtypes) > 1:
        dtypes = {np.dtype(np.object_) if _lossy(dtypes, arrays) else np.result_type(*dtypes)}
    dtype = dtypes.pop() if dtypes else np.dtype(np.float64)
    blank: Any = np.nan if dtype.kind == "f" else None if dtype == np.object_ else 0
    values = np.full(len(valid), blank, dtype)
    begin = 0
    for part in parts:
        here = values[begin : begin + len(part.valid)]
        here[part.valid] = part.values[part.valid].tolist() if dtype == np.object_ else part.values[part.valid]
        begin += len(part.valid)
    return Gathered(values, valid)


def _lossy(dtypes: set[np.dtype[Any]], arrays: list[NDArray[Any]]) -> bool:
    kinds = {dtype.kind for dtype in dtypes}
    if not kinds <= {"i", "u", "f"}:
        return True
    if np.result_type(*dtypes).kind != "f":
        return False
    return any(array.dtype.kind in "iu" and bool((np.abs(array.astype(np.float64)) > _EXACT).any()) for array in arrays)


def _dtype(kinds: set[type], values: list[Scalar | None]) -> type[Any]:
    if kinds == {bool}:
        return np.bool_
    if not kinds or kinds == {float}:
        return np.float64
    integers = [value for value in values if isinstance(value, int)]
    if kinds == {int}:
        low, high = min(integers), max(integers)
        if low >= -(1 << 63) and high < 1 << 63:
            return np.int64
        return np.uint64 if low >= 0 and high < 1 << 64 else np.object_
    exact = kinds == {int, float} and all(-_EXACT <= value <= _EXACT for value in integers)
    return np.float64 if exact else np.object_


def _read(kind: MessageType, payload: bytes, path: str) -> Scalar | None:
    try:
        return kind.read(payload, path)
    except PayloadError:
        return None
