"""Writes tables as Parquet, with pyarrow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus_logtools.export.csv_file import text_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from riot_bus_logtools.export.csv_file import Kind, Rows


class ParquetTableWriter:
    """Writer of Parquet tables: times are timestamps in UTC, and a missing value is null."""

    def __init__(self, path: str, kinds: dict[str, Kind]) -> None:
        import pyarrow as pa
        from pyarrow.parquet import ParquetWriter

        self._arrow = pa
        time = pa.timestamp("ns", "UTC")
        own = {"text": pa.string(), "bytes": pa.binary(), "bool": pa.bool_()}
        fields = [("time", time), ("publish_time", time), ("topic", pa.dictionary(pa.int32(), pa.string()))]
        fields += [(name, own.get(kind) or pa.from_numpy_dtype(np.dtype(kind))) for name, kind in kinds.items()]
        self._schema = pa.schema(fields)
        self._writer = ParquetWriter(path, self._schema, compression="zstd")

    def write(self, rows: Rows) -> None:
        """Append rows."""
        if not len(rows.times):
            return
        pa, fields = self._arrow, list(self._schema)
        arrays = [pa.array(rows.times).cast(fields[0].type), pa.array(rows.publish_times).cast(fields[1].type)]
        arrays.append(pa.array(rows.topics.tolist(), pa.string()).dictionary_encode())
        for field, values, valid in zip(fields[3:], rows.values, rows.valid, strict=True):
            arrays.append(self._array(values, valid, field.type))
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()

    def _array(self, values: NDArray[Any], valid: NDArray[np.bool_], kind: Any) -> Any:
        pa = self._arrow
        if values.dtype != np.object_ and kind not in (pa.string(), pa.binary()):
            return pa.array(values, mask=~valid).cast(kind, safe=False)
        cells = zip(values.tolist(), valid.tolist(), strict=True)
        convert: Callable[[Any], Any] = lambda value: value  # noqa: E731
        if kind == pa.string():
            convert = _text
        elif pa.types.is_floating(kind):
            convert = float
        return pa.array([convert(value) if there else None for value, there in cells], kind)


def _text(value: Any) -> str:
    return str(text_of(value)).encode("utf-8", "backslashreplace").decode()
