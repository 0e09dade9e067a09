"""What is missing of a log is counted once, however often it is come across."""

from __future__ import annotations

from riot_bus.log.engine.blocks import Block, Span
from riot_bus.log.engine.limits import BeyondLimitError
from riot_bus.log.engine.scan import Scan
from riot_bus.log.loss import Loss, LossNotes


def block(number: int) -> Block:
    return Block(number, Span(1000 + number, 10), 0, 0, chunked=True)


def test_nothing_is_missing_of_a_file_that_was_closed() -> None:
    loss = LossNotes().total(Scan(100, finished=True))
    assert not loss
    assert (str(loss), loss.hint) == ("nothing lost", None)
    assert str(LossNotes().total(Scan(100))) == "the file was not closed"


def test_what_is_come_across_twice_counts_once() -> None:
    notes = LossNotes()
    for _ in range(2):
        notes.note_damage(block(1), ValueError("checksum"))
        notes.note_detail(block(2), ValueError("checksum"))
        notes.note_detail(Span(2, 5))
    assert notes.damaged == {1}
    assert notes.total(Scan(100, finished=True)) == Loss(chunks=1, details=2)


def test_what_is_beyond_a_limit_is_no_damage_and_says_how_to_lift_the_first_one() -> None:
    notes = LossNotes()
    notes.note_damage(block(1), BeyondLimitError("a chunk of 9 bytes", "CHUNK", 8, 9))
    notes.note_detail(block(2), BeyondLimitError("extras of 7 bytes", "EXTRAS", 6, 7))
    loss = notes.total(Scan(100, finished=True))
    assert (loss.chunks, loss.beyond, loss.details) == (0, 1, 1)
    assert str(loss).startswith("1 damaged attachments, notes or definitions, 1 chunks beyond the limits (a chunk of")
    assert "CHUNK=9" in loss.limit
    assert "EXTRAS" not in loss.limit
