"""Foxglove's own parsers of logs and of ROS 2 messages, from npm, in a folder of their own."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

from tests.interop import FOXGLOVE, require

PROGRAM = """
import { McapIndexedReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { decompress } from "fzstd";
import { open } from "node:fs/promises";

const file = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    await file.read(buffer, 0, Number(length), Number(offset));
    return buffer;
  },
};
const scalar = (value) => (typeof value === "bigint" ? value.toString() : value);
const plain = (key, value) => (ArrayBuffer.isView(value) ? Array.from(value, scalar) : scalar(value));
const decompressHandlers = { zstd: (data) => decompress(data) };
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
const readers = new Map();
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  if (!readers.has(channel.id)) {
    const schema = reader.schemasById.get(channel.schemaId);
    const definition = parse(new TextDecoder().decode(schema.data), { ros2: true });
    readers.set(channel.id, new MessageReader(definition));
  }
  console.log(JSON.stringify([channel.topic, readers.get(channel.id).readMessage(message.data)], plain));
}
"""


def foxglove_messages(path: Path) -> list[list[Any]]:
    """Return topic and fields of each message as Foxglove reads them; skips the test where npm installs nothing."""
    program = _program()
    try:
        done = subprocess.run(
            ["node", program.name, str(path.resolve())],
            cwd=program.parent,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    finally:
        program.unlink()
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def _program() -> Path:
    program = require(FOXGLOVE) / f"read-{os.getpid()}.mjs"  # beside node_modules, where imports are looked for
    program.write_text(PROGRAM)
    return program
