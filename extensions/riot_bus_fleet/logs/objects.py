"""Logs in object stores and other places that fsspec knows: S3, GCS, Azure, SFTP, HTTP ...

No log is ever loaded into memory as a whole: head and summary are fetched, or all of it is copied to disk.
"""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import MetadataIndex

from riot_bus.log.account import LOST
from riot_bus.log.engine.blocks import MAGIC
from riot_bus.log.engine.scan import parse
from riot_bus.log.layout import RUN
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, needs_extra
from riot_bus_fleet.logs.entry import ENDING, StoredLog

_STAMPS = ("ETag", "etag", "md5Hash", "content_md5", "mtime", "LastModified", "last_modified", "updated", "created")
_BLOCK = 1 << 22  # held in memory by each thread; a smaller log is fetched whole, by one request
_HEAD = 1 << 16  # holds a log's header, which is two short texts, or any index record
_LARGEST_SUMMARY = 1 << 26  # held in memory; a log with a larger one is copied to disk as a whole
_FOOTER = struct.Struct("<BQQQI")
_RECORD = struct.Struct("<BQ")
_CHUNK_INDEX = struct.Struct("<QQQ")
_MOST_RUNS = 16  # a request each, and a summary may list any number of them
_LONGEST_RUN = 1 << 20  # with `_MOST_RUNS`, at most 16 MiB of metadata are fetched of a log


class ObjectStore:
    """A folder behind a URL, or a single log there; raises ConfigError if the URL is wrong, or a package is missing."""

    partial = True

    def __init__(self, url: str) -> None:
        self.refused: list[str] = []
        with needs_extra("fsspec", "fleet"):
            from fsspec.core import url_to_fs
        try:
            self._fs, self._path = url_to_fs(url)
        except ImportError as error:
            raise ConfigError(str(error), where=url, hint="install the package that fsspec names") from error
        except Exception as error:
            raise ConfigError(f"this place cannot be opened: {error}", where=url) from error
        self._within = "".join(url.partition("::")[1:])  # such as `::s3://bucket/logs.zip`
        self.root = self._place(self._path.rstrip("/"))

    def logs(self, failed: Callable[[str], None]) -> Iterator[StoredLog]:
        """Yield all logs, folder by folder; call `failed` with a line about what could not be looked at."""
        try:
            self._fs.invalidate_cache()
            if self._fs.isfile(self._path):
                yield from self._found(self._path, self._fs.info(self._path), self._path.rsplit("/", 2)[-2:][0], failed)
                return
            if not self._fs.exists(self._path):
                failed(f"{self.root}: there is nothing")
                return
            for folder, _, files in self._fs.walk(self._path, detail=True, on_error="raise"):
                below = str(folder)[len(self._path) :].strip("/").partition("/")[0]
                name = below or self._path.rstrip("/").rpartition("/")[2]
                for file, info in files.items():
                    if file.endswith(ENDING):
                        yield from self._found(info.get("name") or f"{folder}/{file}", info, name, failed)
        except Exception as error:  # the exceptions of stores have nothing in common
            failed(f"{self.root}: {_reason(error)}")

    @contextmanager
    def excerpt(self, log: StoredLog) -> Iterator[Path]:
        """Yield a file with head and summary of a log, and its run's metadata; what lies between is a hole."""
        with self._temporary(log) as path:
            parts = self._parts(log)
            if parts is None:
                self._copy(log, path)
            else:
                with path.open("r+b") as file:
                    for start, end in parts:
                        for begin in range(start, end, _BLOCK):
                            file.seek(begin)
                            file.write(self._range(log, begin, min(end, begin + _BLOCK)))
                    file.truncate(log.size)
            yield path

    @contextmanager
    def whole(self, log: StoredLog) -> Iterator[Path]:
        """Yield a copy of a log on this machine's disk."""
        with self._temporary(log) as path:
            self._copy(log, path)
            yield path

    def _found(
        self, path: str, info: Mapping[str, Any], folder: str, failed: Callable[[str], None]
    ) -> Iterator[StoredLog]:
        size = info.get("size")
        place = self._place(path)
        if not isinstance(size, int):
            failed(f"{place}: the store does not say how large it is")
            return
        stamp = next((str(info[name]) for name in _STAMPS if info.get(name)), "")
        yield StoredLog(place, size, stamp, folder)

    def _place(self, path: str) -> str:
        return f"{self._fs.unstrip_protocol(path).rstrip('/')}{self._within}"

    def _inner_path(self, log: StoredLog) -> Any:
        return self._fs._strip_protocol(log.place.removesuffix(self._within))

    def _parts(self, log: StoredLog) -> list[tuple[int, int]] | None:
        """Return the byte ranges that describe a log's contents; None if all of it has to be read."""
        size, foot = log.size, _FOOTER.size + len(MAGIC)
        if size <= _BLOCK:
            return None
        tail = self._range(log, size - foot, size)
        opcode, length, start, _, _ = _FOOTER.unpack_from(tail)
        if tail[_FOOTER.size :] != MAGIC or opcode != Opcode.FOOTER or length != _FOOTER.size - _RECORD.size:
            return None
        if not _HEAD < start <= size - foot or size - start > _LARGEST_SUMMARY:
            return None
        summary = b"".join(self._range(log, begin, min(size, begin + _BLOCK)) for begin in range(start, size, _BLOCK))
        # Right before the summary stands the record that ends the data.
        return [(0, _HEAD), *_needed(summary, size), (start - 13, size)]

    def _range(self, log: StoredLog, start: int, end: int) -> bytes:
        try:
            found = bytes(self._fs.cat_file(self._inner_path(log), start=start, end=end))
        except Exception as error:
            raise EnvironmentFaultError(f"cannot be read: {_reason(error)}", where=log.place) from error
        if len(found) != end - start:
            raise EnvironmentFaultError(
                f"{len(found)} bytes came instead of {end - start}", where=log.place, hint="did it change meanwhile?"
            )
        return found

    def _copy(self, log: StoredLog, path: Path) -> None:
        try:
            self._fs.get_file(self._inner_path(log), str(path))
        except Exception as error:
            raise EnvironmentFaultError(f"cannot be copied: {_reason(error)}", where=log.place) from error

    @contextmanager
    def _temporary(self, log: StoredLog) -> Iterator[Path]:
        with tempfile.TemporaryDirectory(prefix="riot-fleet-") as folder:
            path = Path(folder) / "log.mcap"
            path.touch()
            yield path


def _needed(summary: bytes, size: int) -> list[tuple[int, int]]:
    """Return the byte ranges before the summary that describe the run and its losses, or check the summary."""
    runs: list[tuple[int, int]] = []
    chunks: list[tuple[int, int]] = []
    position = 0
    while position + _RECORD.size <= len(summary):
        opcode, length = _RECORD.unpack_from(summary, position)
        position += _RECORD.size
        body = summary[position : position + min(length, _HEAD)]
        position += length
        if opcode == Opcode.CHUNK_INDEX and len(body) >= _CHUNK_INDEX.size:
            offset = _CHUNK_INDEX.unpack_from(body)[2]
            chunks = [*chunks[:1], (offset, offset + _RECORD.size)]  # the first and the last one
        elif opcode == Opcode.METADATA_INDEX and len(runs) < _MOST_RUNS:
            index = parse(MetadataIndex, body)
            if index is not None and index.name in (RUN, LOST) and index.length <= _LONGEST_RUN:
                runs.append((index.offset, index.offset + index.length))
    return [(begin, end) for begin, end in (*chunks, *runs) if begin < end <= size]


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {str(error)[:200]}"
