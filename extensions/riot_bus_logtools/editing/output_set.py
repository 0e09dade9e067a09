"""Writes the output of an edit: messages split by time, size or topic, other records of the inputs, and a summary."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from riot_bus import __version__
from riot_bus.given_files import given_text
from riot_bus.log import layout
from riot_bus.log.account import LOST, Account, account_of
from riot_bus.log.rosbag2 import FIELD, RECORD, BagDetails, BagFile, bag_details, bag_of, bag_record, bag_text
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus_logtools.editing.output_file import OutputFile
from riot_bus_logtools.editing.result import WrittenFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from riot_bus_logtools.editing.batch import Batch
    from riot_bus_logtools.editing.channel_edit import OutputChannel
    from riot_bus_logtools.editing.channel_table import ChannelTable
    from riot_bus_logtools.editing.inputs import InputLog
    from riot_bus_logtools.editing.options import EditOptions


_NO_NAME = re.compile(r"[^\w.-]+", re.ASCII)
_LONGEST = 100  # file names have 255 bytes at most; stem and number need some of them
METADATA = "metadata.yaml"


class Outputs:
    """Gives files their names; raises ConfigError if the output is an input, exists already, or cannot be created."""

    def __init__(self, options: EditOptions, inputs: Sequence[Path]) -> None:
        self._output, self._folder, self._force = options.output, options.folder, options.force
        self._inputs = [os.stat(path) for path in inputs]
        self._names: dict[str, Path] = {}
        self._place: Path | None = None
        if options.dry_run:
            return
        if options.folder or not options.splits:
            self._check(options.output)
        for path in sorted(options.output.iterdir()) if options.folder and options.output.is_dir() else ():
            self._check_inside(path)
        self._place = self._make_place()

    def path(self, label: str | None) -> tuple[Path, str]:
        """Return where to write a file, and its final path; raises ConfigError if that exists.

        The label distinguishes the file from others; None if there are none.
        """
        assert self._place is not None
        stem = self._output.name if self._folder else self._output.stem
        if label is None:
            name = f"{stem}_0.mcap" if self._folder else self._output.name
        else:
            name = f"{stem}_{_NO_NAME.sub('_', label).strip('_')[:_LONGEST] or 'topic'}.mcap"
        taken, number = name, 1
        while taken in self._names:
            number += 1
            taken = name.removesuffix(".mcap") + f"-{number}.mcap"
        final = (self._output if self._folder else self._output.parent) / taken
        if label is not None:
            self._check(final)
        self._names[taken] = final
        return self._place / taken, str(final)

    def metadata(self, text: str) -> None:
        """Write the `metadata.yaml` of a bag; raises OSError."""
        assert self._place is not None
        (self._place / METADATA).write_text(text, encoding="utf-8")
        self._names[METADATA] = self._output / METADATA

    def commit(self) -> None:
        """Give all files their names; raises EnvironmentFaultError, or ConfigError for one that has come to exist."""
        if self._place is None:
            return
        try:
            if self._folder:
                self._output.mkdir(parents=True, exist_ok=True)
                for path in list(self._output.iterdir()):
                    if path.name == METADATA or path.suffix == ".mcap":
                        path.unlink(missing_ok=True)
            for name, final in self._names.items():
                if not self._folder:
                    self._check(final)
                os.replace(self._place / name, final)
        except OSError as error:
            raise EnvironmentFaultError(f"cannot write: {error.strerror}", where=str(self._output)) from error
        self.discard()

    def discard(self) -> None:
        """Remove temporary files; safe to call twice."""
        if self._place is not None:
            shutil.rmtree(self._place, ignore_errors=True)
            self._place = None

    def _make_place(self) -> Path:
        parent = self._output.parent
        try:
            if self._folder:
                parent.mkdir(parents=True, exist_ok=True)
            return Path(tempfile.mkdtemp(prefix=f".{self._output.name[:_LONGEST]}.", suffix=".part", dir=parent))
        except OSError as error:
            raise ConfigError(f"cannot write there: {error.strerror}", where=str(self._output)) from error

    def _check(self, path: Path) -> None:
        try:
            there = os.stat(path)
        except FileNotFoundError:
            return
        except OSError as error:
            raise ConfigError(f"cannot write there: {error.strerror}", where=str(path)) from error
        self._check_other(path, there)
        if path.is_dir():
            if not self._folder or path != self._output:
                raise ConfigError("this is a folder", where=str(path), hint="name a file that ends in .mcap")
            if not self._force and any(path.iterdir()):
                raise ConfigError("this folder exists and is not empty", where=str(path), hint="--force replaces it")
        elif self._folder and path == self._output:
            raise ConfigError("this is a file", where=str(path), hint="end its name in .mcap, or name a folder")
        elif not self._force:
            raise ConfigError("this file exists", where=str(path), hint="--force replaces it")

    def _check_inside(self, path: Path) -> None:
        """Check that a file in the output folder is part of a bag, before the folder is replaced."""
        if path.name != METADATA and path.suffix != ".mcap":
            hint = "name a folder that does not exist"
            raise ConfigError(f"this folder holds other things than a bag: {path.name}", where=str(path), hint=hint)
        self._check_other(path, os.stat(path))

    def _check_other(self, path: Path, status: os.stat_result) -> None:
        """Raise ConfigError if a file is one of the inputs."""
        if any(os.path.samestat(status, each) for each in self._inputs):
            raise ConfigError("input and output are the same", where=str(path), hint="name another output")


EDIT = "riot_bus.edit"
"""Name of the metadata record that says what was done."""


class _Part(NamedTuple):
    """One file of the output, its temporary path, and the path that it gets in the end."""

    file: OutputFile
    path: Path
    final: str


class OutputSet:
    """The files that an edit writes; none has its final name before `commit`.

    In `unwritable` are the messages, by topic, whose time does not fit into a log. Raises ConfigError if the output is
    an input, exists, or cannot be created.
    """

    def __init__(self, options: EditOptions, paths: Sequence[Path]) -> None:
        self.unwritable: Counter[str] = Counter()
        self._options = options
        self._outputs = Outputs(options, paths)
        self._profile = self._compression = ""
        self._records: list[tuple[str, dict[str, str]]] = []
        self._details = BagDetails()
        self._parts: list[_Part] = []
        self._current: dict[str, OutputFile] = {}
        self._numbers: Counter[str] = Counter()
        self._begins: dict[str, int] = {}

    def open(self, inputs: Sequence[InputLog], table: ChannelTable) -> None:
        """Open the files that are known from the beginning."""
        options = self._options
        if options.dry_run:
            return
        self._take_over(inputs, table)
        profiles = {log.profile for log in inputs}
        self._profile = "ros2" if options.folder else profiles.pop() if len(profiles) == 1 else ""
        compression = options.compression or next((log.compression for log in inputs if log.compression), None)
        self._compression = compression or "zstd"
        for target in table.targets():
            label = target.name if options.split_topics else ""
            (self._current.get(label) or self._open_file(label)).define(target)
        first = self._parts[0].file if self._parts else self._open_file("")
        for log in inputs:
            for attachment in log.attachments():
                first.attachment(attachment)

    def write(
        self,
        batch: Batch,
        targets: Sequence[OutputChannel | None],
        ready: Callable[[], tuple[str, bytes] | None] | None,
    ) -> None:
        """Write messages to the files they belong to; `ready` returns the chunk that holds exactly these, if any."""
        if self._options.dry_run:
            return
        whole = len(batch)
        for label, share in self._shares(batch, targets):
            while len(share):
                file = self._file_at(label, int(share.time[0]))
                count = self._fitting(label, share)
                piece = share if count == len(share) else share.take(slice(0, count))
                found = ready() if ready is not None and count == whole else None
                if found is None or not file.copy(piece, targets, found):
                    file.write(piece, targets)
                share = share.take(slice(count, None))

    def warnings(self, table: ChannelTable) -> list[str]:
        """Return warnings about the output."""
        if not self._options.folder:
            return []
        odd = sorted(
            {each.name for each in table.targets() if each.schema is None or each.channel.message_encoding != "cdr"}
        )
        text = "ros2 bag reads no bag with topics that are not of ROS 2"
        return [f"{text}: {', '.join(odd[:5])}; leave them out with --drop"] if odd else []

    def refuse(self, topic: str) -> None:
        """Count a message whose time does not fit into a log."""
        self.unwritable[topic] += 1

    def commit(self, inputs: Sequence[InputLog], table: ChannelTable) -> list[WrittenFile]:
        """Finish all files, give them their names, and return them; raises ConfigError or EnvironmentFaultError."""
        if self._options.dry_run:
            return []
        summary = self._summary(inputs, table)
        bag: list[BagFile] = []
        for file, _, final in self._parts:
            file.drain()
            bag.append(_bag_file(file, final))
            if self._details.present:
                file.metadata(RECORD, bag_record(bag[-1], self._details))
            file.metadata(EDIT, summary)
            file.finish()
        written = [WrittenFile(final, path.stat().st_size, file.messages) for file, path, final in self._parts]
        self._close()
        if self._options.folder:
            self._outputs.metadata(bag_text(bag, self._details))
        self._outputs.commit()
        return written

    def discard(self) -> None:
        """Remove temporary files; safe to call twice, and after `commit`."""
        self._close()
        self._outputs.discard()

    def _close(self) -> None:
        for part in self._parts:
            part.file.close()

    def _take_over(self, inputs: Sequence[InputLog], table: ChannelTable) -> None:
        """Read the records of the inputs that the output holds, too."""
        accounts: list[Account] = []
        for log in reversed(inputs):  # of several values the last one counts: that of the first input
            account: Account | None = None
            for name, mapping in log.metadata_records():
                if name == RECORD and FIELD in mapping:
                    self._details = bag_details(mapping[FIELD], mapping)
                elif name == LOST and (found := account_of(mapping)) is not None:
                    account = found
                else:
                    self._records.append((name, dict(mapping)))
            accounts += [account] if account is not None else []
        if accounts:
            names = {each.topic: each.written_as for each in table.counts() if each.written_as}
            self._records.append((LOST, Account.total_of(accounts, names).record()))
        if not self._details.present and self._options.folder:
            self._details = self._details_beside()

    def _details_beside(self) -> BagDetails:
        """Return the details in the `metadata.yaml` beside the first input."""
        path = self._options.inputs[0]
        folder = path if path.is_dir() else path.parent
        try:
            text = given_text(folder / METADATA, inside=folder).replace("\r\n", "\n")
        except (OSError, UnicodeDecodeError):
            return BagDetails(present=True)
        return bag_details(text)

    def _summary(self, inputs: Sequence[InputLog], table: ChannelTable) -> dict[str, str]:
        """Return the metadata record that says what was done."""
        total = {
            counts.topic: {name: getattr(counts, name) for name in ("kept", "changed", "dropped", "added")}
            for counts in table.counts()
        }
        logs: list[dict[str, Any]] = [
            {"name": os.path.basename(log.path), "size": log.size, **({"lost": str(log.loss)} if log.loss else {})}
            for log in inputs
        ]
        return {
            "riot_bus": __version__,
            "inputs": json.dumps(logs),
            "steps": json.dumps(self._options.to_json()),
            "messages": json.dumps(total),
        }

    def _shares(self, batch: Batch, targets: Sequence[OutputChannel | None]) -> Iterator[tuple[str, Batch]]:
        """Yield the label of each sequence of files, and the messages that it gets."""
        if not self._options.split_topics:
            yield "", batch
            return
        written = [(number, targets[number]) for number in np.unique(batch.edit).tolist()]
        labels = {number: target.name for number, target in written if target is not None}
        for label in dict.fromkeys(labels.values()):
            numbers = [number for number, each in labels.items() if each == label]
            yield label, batch.where(np.isin(batch.edit, numbers))

    def _file_at(self, label: str, time: int) -> OutputFile:
        """Return the file for a message at a time; another one than before if that is old or large enough."""
        file, options = self._current.get(label), self._options
        if file is not None:
            self._begins.setdefault(label, time)
            late = options.split_seconds is not None and time >= self._begins[label] + options.split_seconds * 1e9
            large = options.split_bytes is not None and file.messages and file.size() >= options.split_bytes
            if not late and not large:
                return file
            file.drain()  # this file gets no more messages, only records about the whole edit
        span = int((options.split_seconds or 0.0) * 1e9)
        earlier = self._begins.get(label)
        self._begins[label] = time if earlier is None or not span else earlier + (time - earlier) // span * span
        return self._open_file(label)

    def _fitting(self, label: str, share: Batch) -> int:
        """Return how many messages go into the current file before it may have to be changed."""
        count = len(share)
        if self._options.split_seconds is not None:
            end = self._begins[label] + self._options.split_seconds * 1e9
            later = np.flatnonzero(share.time >= np.uint64(min(int(end), (1 << 64) - 1)))
            count = int(later[0]) if len(later) else count
        if self._options.split_bytes is not None:
            room = self._options.split_bytes - self._current[label].size()
            sizes = np.cumsum(share.end - share.start)
            count = min(count, int(np.searchsorted(sizes, max(room, 1), side="left")) + 1)
        return max(count, 1)

    def _open_file(self, label: str) -> OutputFile:
        options = self._options
        names = [label] if options.split_topics else []
        if options.split_seconds is not None or options.split_bytes is not None:
            names.append(str(self._numbers[label]))
        self._numbers[label] += 1
        path, final = self._outputs.path("_".join(names) if names else None)
        file = OutputFile(
            path, final, profile=self._profile, compression=self._compression, chunk_bytes=options.chunk_bytes
        )
        self._parts.append(_Part(file, path, final))
        self._current[label] = file
        for name, mapping in self._records:
            file.metadata(name, mapping)
        return file


def _bag_file(file: OutputFile, final: str) -> BagFile:
    targets, counts = file.targets()
    schemas = {each.schema.id: each.schema for each in targets if each.schema is not None}
    shown = [each.channel for each in targets if not each.channel.topic.startswith(layout.ORIGINAL_PREFIX)]
    return bag_of(os.path.basename(final), shown, list(schemas.values()), counts, *file.span)
