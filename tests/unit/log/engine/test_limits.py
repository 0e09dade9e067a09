import pytest

from riot_bus.log.engine.limits import BeyondLimitError, LogLimits


def test_a_large_chunk_must_not_be_compressed_too_well():
    limits = LogLimits(loose=1 << 20, ratio=10, chunk=1 << 24)
    limits.check_size(1 << 20, 100)
    limits.check_size(10 << 20, 1 << 20)
    with pytest.raises(BeyondLimitError, match="11 times as large as compressed, more than ratio=10") as caught:
        limits.check_size(11 << 20, 1 << 20)
    assert caught.value.lift == "ratio=11"
    with pytest.raises(BeyondLimitError, match="more than chunk=16777216"):
        limits.check_size((1 << 24) + 1, 1 << 24)


def test_what_no_compression_reaches_is_damage():
    with pytest.raises(ValueError, match="cannot be made of 100") as caught:
        LogLimits().check_size(1 << 60, 100)
    assert not isinstance(caught.value, BeyondLimitError)


def test_large_files_may_have_more_chunks():
    limits = LogLimits(chunks=10)
    assert (limits.chunks_of(1000), limits.chunks_of(1 << 20)) == (10, 26)
