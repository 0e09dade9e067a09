from __future__ import annotations

from typing import Any

import pytest

from riot_bus.config.arguments import parse_seconds, parse_size
from riot_bus.record.options import CaptureOptions, parse_throttles
from riot_bus.vocabulary.errors import ConfigError


@pytest.mark.parametrize(
    ("text", "size"),
    [("65536", 65536), ("500MB", 500_000_000), ("1GiB", 1 << 30), ("1.5k", 1500), ("2 Mi", 2 << 20), ("3b", 3)],
)
def test_sizes(text: str, size: int) -> None:
    assert parse_size(text, "--x") == size


@pytest.mark.parametrize(
    ("text", "seconds"), [("90", 90), ("90s", 90), ("15min", 900), ("30m", 1800), ("1h", 3600), ("50ms", 0.05)]
)
def test_times(text: str, seconds: float) -> None:
    assert parse_seconds(text, "--x") == seconds


@pytest.mark.parametrize("text", ["", "x", "-1", "1e9", "1 year", "nan", "MB"])
def test_what_is_no_size_and_no_time(text: str) -> None:
    with pytest.raises(ConfigError, match="is not a size"):
        parse_size(text, "--x")
    with pytest.raises(ConfigError, match="is not a time"):
        parse_seconds(text, "--x")


def test_throttles() -> None:
    assert parse_throttles(["/camera=5", "a/**=0.5"]) == {"/camera": 5.0, "a/**": 0.5}
    for text in ("/camera", "=5", "/camera=0", "/camera=-1", "/camera=inf", "/camera=x"):
        with pytest.raises(ConfigError, match="how often"):
            parse_throttles([text])


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"keys": ()}, "nothing is to be recorded"),
        ({"keys": ["a"] * 1000}, "too many"),
        ({"chunk_bytes": 1}, "a chunk cannot have 1 bytes"),
        ({"chunk_seconds": -1.0}, "is not a number"),
        ({"split_seconds": float("nan")}, "is not a number"),
        ({"chunk_seconds": -1.0}, "--chunk-duration"),
        ({"queue_bytes": -1}, "--queue-size: -1 is not a number"),
        ({"name": "a/b"}, "is not a name"),
        ({"dump_on": ["/a where b > 1"]}, "need a ring"),
        ({"ring_seconds": 1.0, "dump_on": ["/a:b where b > 1"]}, "not a condition"),
        ({"ring_seconds": 1.0, "split_bytes": 1}, "nothing to split"),
        ({"max_files": 1}, "more than one file"),
    ],
)
def test_what_contradicts_itself(options: dict[str, Any], text: str) -> None:
    CaptureOptions().check()
    with pytest.raises(ConfigError, match=text):
        CaptureOptions(**options).check()
