from __future__ import annotations

import numpy as np
import pytest

from riot_bus.log.tables.plan import log_registry
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message
from riot_bus_fleet.evidence.log_columns import read_pieces
from tests.unit.chain.offline import BEGIN, write_log


@pytest.fixture
def log(tmp_path):
    return write_log(tmp_path / "a.mcap", np.random.default_rng(0), count=60)


def test_numbers_of_all_topics_are_read_without_texts_and_sequence_numbers(log):
    found = read_pieces([log], log_registry)
    (piece,) = found.pieces
    assert sorted(piece.times) == ["battery", "goal", "map", "odom", "unit"]
    assert sorted(name for name in piece.values if name.startswith("goal:")) == [
        "goal:len(list)",
        *(f"goal:list[{at}]" for at in range(4)),
        "goal:mode",
        "goal:on",
        "goal:v",
    ]
    assert piece.times["goal"][:2] == pytest.approx([BEGIN / 1e9, BEGIN / 1e9 + 0.1])
    assert len(piece.values["goal:v"]) == len(piece.values["goal:mode"]) == 60
    assert np.ptp(piece.values["goal:mode"]) == 0
    assert found.topics == dict.fromkeys(["battery", "goal", "map", "odom", "unit"], 60)
    assert (found.messages, found.looked_at, found.notes) == (300, 300, [])


def test_a_field_that_is_asked_for_is_read_whatever_it_is(log):
    (piece,) = read_pieces([log], log_registry, wanted=["unit:seq"]).pieces
    assert "unit:seq" in piece.values


def test_small_differences_of_large_numbers_are_kept(tmp_path):
    with LogWriter(tmp_path / "a.mcap") as writer:
        for at in range(20):
            body = b'{"lat": %.9f}' % (47.0 + at * 1e-7)
            writer.write(Message(BEGIN + at, "gps", body, encoding="application/json"))
    (piece,) = read_pieces([tmp_path / "a.mcap"], log_registry).pieces
    assert np.diff(piece.values["gps:lat"]) == pytest.approx(np.full(19, 1e-7), rel=1e-3)


def test_missing_values_are_not_numbers(tmp_path):
    with LogWriter(tmp_path / "a.mcap") as writer:
        for at in range(6):
            body = b'{"x": %d, "y": 1}' % at if at % 2 else b'{"y": 2}'
            writer.write(Message(BEGIN + at, "t", body, encoding="application/json"))
    (piece,) = read_pieces([tmp_path / "a.mcap"], log_registry).pieces
    assert np.isnan(piece.values["t:x"]).tolist() == [True, False] * 3


def test_more_than_memory_allows_is_looked_at_in_stretches_and_said(log):
    found = read_pieces([log], log_registry, memory=2000)
    assert len(found.pieces) == 10
    assert 0 < found.looked_at < 150
    assert "of the time was looked at, in 10 stretches of each log" in found.notes[0]


def test_damage_is_told(log):
    data = log.read_bytes()
    log.write_bytes(data[: len(data) // 2])
    found = read_pieces([log], log_registry)
    assert str(log) in found.notes[0]
