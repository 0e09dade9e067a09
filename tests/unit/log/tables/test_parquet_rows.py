import pytest

from riot_bus.log.tables.parquet_rows import write_rows
from riot_bus.vocabulary.errors import ConfigError

parquet = pytest.importorskip("pyarrow.parquet")


def test_rows_come_back(tmp_path):
    rows = [{"a": 1, "b": "x"}, {"a": 2, "b": None}]
    write_rows(tmp_path / "a.parquet", rows)
    assert parquet.read_table(tmp_path / "a.parquet").to_pylist() == rows
    with pytest.raises(ConfigError, match="exists"):
        write_rows(tmp_path / "a.parquet", rows)
    with pytest.raises(ConfigError, match="written as"):
        write_rows(tmp_path / "a.csv", rows)
