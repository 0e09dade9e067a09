"""Writes the output of an edit: messages split by time, size or topic, other records of the inputs, and a summary."""

from __future__ import annotations

import json
import os
from collections import Counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from riot_bus import __version__
from riot_bus.given_files import given_text
from riot_bus.log import layout
from riot_bus.log.account import LOST, Account, account_of
from riot_bus.log.rosbag2 import FIELD, RECORD, BagDetails, BagFile, bag_details, bag_of, bag_record, bag_text
from riot_bus_logtools.editing.output_file import OutputFile
from riot_bus_logtools.editing.outputs import METADATA, Outputs
from riot_bus_logtools.editing.result import WrittenFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from riot_bus_logtools.editing.batch import Batch
    from riot_bus_logtools.editing.channel_table import ChannelTable
    from riot_bus_logtools.editing.inputs import InputLog
    from riot_bus_logtools.editing.options import EditOptions
    from riot_bus_logtools.editing.targets import OutputChannel

EDIT = "riot_bus.edit"
"""Name of the metadata record that says what was done."""


class _Part(NamedTuple):
    """One file of the output, its temporary path, and the path that it gets in the end."""

    file: OutputFile
    path: Path
    final: str


class OutputSet:
    """The files that an edit writes; none has its final name before `commit`.

    Attributes:
        unwritable: Messages, by topic, whose time does not fit into a log.

    Raises:
        ConfigError: The output is an input, exists, or cannot be created.
    """

    def __init__(self, options: EditOptions, paths: Sequence[Path]) -> None:
        self.unwritable: Counter[str] = Counter()
        self._options = options
        self._outputs = Outputs(
            options.output,
            folder=options.folder,
            splits=options.splits,
            inputs=paths,
            force=options.force,
            dry=options.dry_run,
        )
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
            (self._current.get(label) or self._open_file(label)).open([target])
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
        """Write messages to the files that they belong to.

        Args:
            batch: Messages to write.
            targets: Channels of the output, by number of the channel edit.
            ready: Function that returns compression and data of the chunk that holds exactly these messages, if any.
        """
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
        """Finish all files, give them their names, and return them.

        Raises:
            ConfigError: Such a file has been created in the meantime.
            EnvironmentFaultError: The disk is full or broken.
        """
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
            self._records.append((LOST, Account.total_of(accounts).renamed(names).record()))
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
        labels = {number: _known(targets[number]).name for number in np.unique(batch.edit).tolist()}
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


def _known(target: OutputChannel | None) -> OutputChannel:
    assert target is not None, "messages of channels without a target are not written"
    return target


def _bag_file(file: OutputFile, final: str) -> BagFile:
    targets = file.targets()
    schemas = {each.schema.id: each.schema for each, _ in targets if each.schema is not None}
    counts = {each.channel.id: count for each, count in targets}
    shown = [each.channel for each, _ in targets if not each.channel.topic.startswith(layout.ORIGINAL_PREFIX)]
    return bag_of(os.path.basename(final), shown, list(schemas.values()), counts, *file.span)
