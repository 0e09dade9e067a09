"""Limits of what is read of a log: a small file must not take much memory, nor its numbers much time."""

from __future__ import annotations

from dataclasses import dataclass

LARGEST_CHUNK = 1 << 28  # bytes that a writer may put into a chunk: above, `iter_columns` has no room
_PER_CHUNK = 1 << 16  # a chunk of 1 MiB that is compressed to a sixteenth; less is harmless
_MOST_RATIO = 1 << 15  # of zstd: a block of 128 KiB that repeats one byte takes 4 bytes


class BeyondLimitError(ValueError):
    """Something would take more than a limit allows."""

    def __init__(self, what: str, name: str, value: int, needed: int) -> None:
        super().__init__(f"{what}, more than {name}={value}")
        self.lift = f"{name}={needed}"


@dataclass(frozen=True, slots=True, kw_only=True)
class LogLimits:
    """Limits of what is read; anything beyond them is treated as damage.

    Attributes:
        chunk: Most bytes of a chunk or attachment, uncompressed.
        ratio: Largest ratio of uncompressed to compressed size of a chunk with more than `loose` bytes, and of all
            chunks of a file together with more than `total` bytes. Files of nine robots have ratios from 0.3 to 6.
        loose: Most bytes of a chunk that may be compressed in any ratio: blank images reach 30000, but chunks of them
            are small. A larger chunk is one large message, and such messages hold more than zeros.
        total: Most bytes of all chunks of a file, uncompressed, that may be compressed in any ratio: those of a single
            chunk, so that nothing is refused for its sum alone, take 2 s, and hold 39 s of blank images (640x480, RGB)
            at 30 Hz. A longer recording of blank images has other topics, too.
        chunks: Most chunks, and runs of messages outside of any; one more is allowed for each 64 KiB of the file.
        messages: Most messages of a chunk.
        held: Most bytes that are read ahead, and of messages that wait for earlier ones of other chunks.
        definitions: Most bytes of all schemas and channels, and of a single record of metadata.
    """

    chunk: int = 1 << 30
    ratio: int = 200
    loose: int = 1 << 27
    total: int = 1 << 30
    chunks: int = 1 << 18
    messages: int = 1 << 20
    held: int = 1 << 28
    definitions: int = 1 << 26

    def check_size(self, size: int, packed: int) -> None:
        """Raise BeyondLimitError if a size is beyond the limits, ValueError if `packed` bytes cannot give it."""
        if size > _MOST_RATIO * packed and size > _PER_CHUNK:
            raise ValueError(f"{size} bytes cannot be made of {packed}")
        if size > self.chunk:
            raise BeyondLimitError(f"{size} bytes", "chunk", self.chunk, size)
        if size > self.loose and size > self.ratio * packed:
            needed = -(-size // max(packed, 1))
            raise BeyondLimitError(f"{size} bytes, {needed} times as large as compressed", "ratio", self.ratio, needed)

    def check_messages(self, count: int) -> None:
        """Raise BeyondLimitError if a chunk has more messages than allowed; not all may have been counted."""
        if count > self.messages:
            raise BeyondLimitError(f"more than {self.messages} messages", "messages", self.messages, 4 * self.messages)

    def chunks_of(self, size: int) -> int:
        """Return how many chunks a file of this size (bytes) may have."""
        return self.chunks + size // _PER_CHUNK


DEFAULT_LIMITS = LogLimits()
