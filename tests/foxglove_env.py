"""Foxglove's own parsers of logs and of ROS 2 messages, from npm, in a folder of their own."""

from __future__ import annotations

import fcntl
import json
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.ros2_env import cache_folder

PACKAGES = ("@mcap/core@2.2.2", "@foxglove/rosmsg@5.0.5", "@foxglove/rosmsg2-serialization@3.1.0", "fzstd@0.1.1")
INSTALL_S = 200
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
    done = subprocess.run(
        ["node", program.name, str(path.resolve())],
        cwd=program.parent,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@cache
def _program() -> Path:
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("Foxglove's parsers cannot be installed: there is no npm")
    folder = cache_folder("foxglove", *PACKAGES)
    program, complete = folder / "read.mjs", folder / "complete"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not complete.exists():
            install = ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", ".", *PACKAGES]
            try:
                done = subprocess.run(
                    install, cwd=folder, capture_output=True, text=True, timeout=INSTALL_S, check=False
                )
            except subprocess.TimeoutExpired:
                pytest.skip(f"Foxglove's parsers cannot be installed: npm took over {INSTALL_S} s")
            if done.returncode:
                pytest.skip(f"Foxglove's parsers cannot be installed: {done.stderr.strip().splitlines()[-1:]}")
            complete.touch()
        program.write_text(PROGRAM)
    return program
