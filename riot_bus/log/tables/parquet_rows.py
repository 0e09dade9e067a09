"""Writes rows as a Parquet file, with pyarrow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from riot_bus.vocabulary.errors import ConfigError, require_package


def write_rows(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows, all with the same columns, to a new Parquet file; raises ConfigError or MissingExtraError."""
    if path.suffix != ".parquet" or path.exists():
        why = "the file exists" if path.exists() else "a table is written as .parquet"
        raise ConfigError(why, where=str(path), hint="choose another name")
    require_package("pyarrow", "export")
    import pyarrow as pa
    from pyarrow.parquet import write_table

    write_table(pa.Table.from_pylist(list(rows)), path, compression="zstd")
