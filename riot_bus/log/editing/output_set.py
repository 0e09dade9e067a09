"""What an edit produces: files with messages, other records of the inputs, and a record of the edit itself."""

from __future__ import annotations

import json
import os
from collections import Counter
from typing import TYPE_CHECKING, Any

from riot_bus import __version__
from riot_bus.log import layout
from riot_bus.log.account import LOST, Account, account_of
from riot_bus.log.editing.bags import FIELD, Former, former_of, metadata_text, record_of
from riot_bus.log.editing.outputs import METADATA, Outputs
from riot_bus.log.editing.sink import FileSink
from riot_bus.log.rosbag2 import RECORD, BagFile, bag_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from riot_bus.log.editing.batch import Batch
    from riot_bus.log.editing.channel_table import ChannelTable
    from riot_bus.log.editing.inputs import InputLog
    from riot_bus.log.editing.options import EditOptions
    from riot_bus.log.editing.output_file import OutputFile, ReadyChunk
    from riot_bus.log.editing.result import WrittenFile
    from riot_bus.log.editing.targets import OutputChannel

__all__ = ["EDIT", "OutputSet"]

EDIT = "riot_bus.edit"
"""Name of the metadata record that says what was done."""


class OutputSet:
    """The output of an edit; no file has its final name before `commit`.

    Args:
        options: Options of the edit.
        paths: Paths of the inputs.

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
        self._sink: FileSink | None = None
        self._records: list[tuple[str, dict[str, str]]] = []
        self._former = Former()

    def open(self, inputs: Sequence[InputLog], roster: ChannelTable) -> None:
        """Open the output.

        Args:
            inputs: Logs that are edited.
            roster: Table of the channels.
        """
        if self._options.dry_run:
            return
        self._take_records(inputs, roster)
        profiles = {log.profile for log in inputs}
        compression = self._options.compression or next((log.compression for log in inputs if log.compression), None)
        self._sink = FileSink(
            self._options,
            self._outputs,
            profile="ros2" if self._options.folder else profiles.pop() if len(profiles) == 1 else "",
            compression=compression or "zstd",
            began=self._began,
        )
        for target in roster.targets():
            self._sink.part_for(target).open([target])
        if not self._sink.parts:
            self._sink.part_for(None)
        first = self._sink.parts[0][0]
        for log in inputs:
            for attachment in log.attachments():
                first.attachment(attachment)

    def write(
        self, batch: Batch, targets: Sequence[OutputChannel | None], ready: Callable[[], ReadyChunk | None] | None
    ) -> None:
        """Write messages; see `riot_bus.log.editing.sink.Sink`."""
        if self._sink is not None:
            self._sink.write(batch, targets, ready)

    def warnings(self, roster: ChannelTable) -> list[str]:
        """Return warnings about the output."""
        if not self._options.folder:
            return []
        odd = sorted(
            {each.name for each in roster.targets() if each.schema is None or each.channel.message_encoding != "cdr"}
        )
        text = "ros2 bag reads no bag with topics that are not of ROS 2"
        return [f"{text}: {', '.join(odd[:5])}; leave them out with --drop"] if odd else []

    def refuse(self, topic: str) -> None:
        """Count a message whose time does not fit into a log."""
        self.unwritable[topic] += 1

    def commit(self, inputs: Sequence[InputLog], roster: ChannelTable) -> list[WrittenFile]:
        """Finish all files, give them their names, and return them.

        Raises:
            ConfigError: Such a file has been created in the meantime.
            EnvironmentFaultError: The disk is full or broken.
        """
        if self._sink is None:
            return []
        told = self._told(inputs, roster)
        bag: list[BagFile] = []
        for part, _, final in self._sink.parts:
            part.drain()
            file = _bag_file(part, final)
            bag.append(file)
            if self._former.present:
                part.metadata(RECORD, record_of(file, self._former))
            part.metadata(EDIT, told)
            part.finish()
        files = self._sink.files()
        self._sink.close()
        if self._options.folder:
            self._outputs.metadata(metadata_text(bag, self._former))
        self._outputs.commit()
        return files

    def discard(self) -> None:
        """Remove temporary files; safe to call twice, and after `commit`."""
        if self._sink is not None:
            self._sink.close()
        self._outputs.discard()

    def _take_records(self, inputs: Sequence[InputLog], roster: ChannelTable) -> None:
        accounts: list[Account] = []
        for log in reversed(inputs):  # of several values the last one counts: that of the first input
            account: Account | None = None
            for name, mapping in log.metadata_records():
                if name == RECORD and FIELD in mapping:
                    self._former = former_of(mapping)
                elif name == LOST and (found := account_of(mapping)) is not None:
                    account = found
                else:
                    self._records.append((name, dict(mapping)))
            accounts += [account] if account is not None else []
        if accounts:
            names = {each.topic: each.written_as for each in roster.counts() if each.written_as}
            self._records.append((LOST, _combined(accounts, names).record()))
        if not self._former.present and self._options.folder:
            self._former = self._beside()

    def _beside(self) -> Former:
        """Return the content of the `metadata.yaml` beside the first input."""
        path = self._options.inputs[0]
        try:
            text = ((path if path.is_dir() else path.parent) / METADATA).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            return Former(present=True)
        former = former_of({FIELD: text})
        return Former(present=True, distro=former.distro, custom=former.custom)

    def _began(self, part: OutputFile) -> None:
        for name, mapping in self._records:
            part.metadata(name, mapping)

    def _told(self, inputs: Sequence[InputLog], roster: ChannelTable) -> dict[str, str]:
        total = {
            counts.topic: {name: getattr(counts, name) for name in ("kept", "changed", "dropped", "added")}
            for counts in roster.counts()
        }
        logs: list[dict[str, Any]] = [
            {"name": os.path.basename(log.path), "size": log.size, **({"lost": str(log.loss)} if log.loss else {})}
            for log in inputs
        ]
        return {
            "riot_bus": __version__,
            "inputs": json.dumps(logs),
            "steps": json.dumps(self._options.told()),
            "messages": json.dumps(total),
        }


def _combined(accounts: Sequence[Account], names: Mapping[str, str]) -> Account:
    """Return the sum of several accounts for the topics that are kept, under their new names."""

    def of_kept(numbers: Sequence[Mapping[str, int]]) -> Counter[str]:
        total: Counter[str] = Counter()
        for each in numbers:
            total.update({names[topic]: count for topic, count in each.items() if topic in names})
        return total

    def by_reason(tables: Sequence[Mapping[str, Mapping[str, int]]]) -> dict[str, Counter[str]]:
        reasons = sorted({reason for table in tables for reason in table})
        return {reason: of_kept([table.get(reason, {}) for table in tables]) for reason in reasons}

    return Account(
        of_kept([each.recorded for each in accounts]),
        by_reason([each.lost for each in accounts]),
        by_reason([each.left_out for each in accounts]),
    )


def _bag_file(part: OutputFile, final: str) -> BagFile:
    targets = part.targets()
    schemas = {each.schema.id: each.schema for each, _ in targets if each.schema is not None}
    counts = {each.channel.id: count for each, count in targets}
    name = final.rpartition("/")[2]
    shown = [each.channel for each, _ in targets if not each.channel.topic.startswith(layout.ORIGINAL_PREFIX)]
    return bag_of(name, shown, list(schemas.values()), counts, *part.span)
