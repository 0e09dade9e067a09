"""Compresses chunks, where it is worthwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from riot_bus.log.engine.checksum import crc32
from riot_bus.log.engine.chunk import LARGE, Buffer, Chunk
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

_LEAST_SHARE = _LEAST_GAIN = 32  # 1/32 of a chunk
_FIRST, _SLICE, _MOST_SLICES = 1 << 12, 1 << 12, 256  # headers are skipped; of few payloads, 1 MiB is sampled at most

_PER_THREAD = threading.local()


def _zstd(pieces: Sequence[bytes]) -> tuple[bytes, ...]:
    try:
        compressor = _PER_THREAD.zstd
    except AttributeError:
        compressor = _PER_THREAD.zstd = zstandard.ZstdCompressor(level=1)  # its buffers are used again
    frame = compressor.compressobj(size=sum(map(len, pieces)))
    return (*map(frame.compress, pieces), frame.flush())


def _lz4(pieces: Sequence[bytes]) -> tuple[bytes, ...]:
    frame = lz4.frame.LZ4FrameCompressor()
    return (frame.begin(sum(map(len, pieces))), *map(frame.compress, pieces), frame.flush())


# In pieces: a whole chunk, and another one compressed, would be allocated and freed by the system each time.
COMPRESSIONS: dict[str, Callable[[Sequence[bytes]], tuple[bytes, ...]]] = {"zstd": _zstd, "lz4": _lz4, "none": tuple}


def check_compression(name: str, where: str) -> None:
    """Raise ConfigError if a compression is unknown."""
    if name not in COMPRESSIONS:
        raise ConfigError(f"unknown compression {name!r}", where=where, hint=did_you_mean(name, COMPRESSIONS))


def worthwhile(compression: str, payloads: Sequence[Buffer], size: int) -> str:
    """Return this compression, or `none` if a sample shows that it would gain next to nothing.

    Compressing data that is compressed already, such as images, takes longer than writing it. A sample does not show
    that a message is in a chunk twice, such as an original and the delivered one; this is checked separately.
    """
    large = sum(map(len, payloads))
    if compression == "none" or not payloads or _LEAST_SHARE * (size - large) > size:
        return compression
    if len({bytes(payload[len(payload) // 2 :][:64]) for payload in payloads}) < len(payloads):
        return compression  # two that agree in the middle are probably copies
    stride = max(LARGE, large // _MOST_SLICES)
    sample = b"".join(
        payload[begin : begin + _SLICE] for payload in payloads for begin in range(_FIRST, len(payload), stride)
    )
    gain = len(sample) - sum(map(len, COMPRESSIONS[compression]((sample,))))
    return compression if _LEAST_GAIN * gain >= len(sample) else "none"


@dataclass(frozen=True, slots=True)
class PackedChunk:
    """A chunk as it is stored in a file: compressed, in pieces; size and CRC are those before compression."""

    compression: str
    data: tuple[bytes, ...]
    size: int
    checksum: int
    start: int
    end: int
    indexes: dict[int, bytes]
    counts: dict[int, int]

    @classmethod
    def of(cls, chunk: Chunk, compression: str) -> PackedChunk:
        """Compress a chunk, if that makes it smaller."""
        checksum = 0
        for piece in chunk.data:
            checksum = crc32(piece, checksum)
        size = sum(map(len, chunk.data))
        compression = worthwhile(compression, chunk.large, size)
        return cls(
            compression,
            COMPRESSIONS[compression](chunk.data),
            size,
            checksum,
            chunk.start,
            chunk.end,
            chunk.indexes,
            chunk.counts,
        )

    @property
    def weight(self) -> int:
        """Approximate bytes in memory."""
        return self.length + sum(map(len, self.indexes.values()))

    @property
    def length(self) -> int:
        """Bytes of the compressed records."""
        return sum(map(len, self.data))
