"""Messages per second of LogWriter and LogReader beside plain mcap, in one run: `python benchmarks/log.py [--json]`."""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable
from pathlib import Path

from common import rate
from mcap.reader import make_reader
from mcap.writer import Writer

from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message

TOPICS = 8


def messages(count: int, size: int, attachment: bytes | None) -> list[Message]:
    body = bytes(range(256)) * (size // 256 + 1)
    return [
        Message(
            10**18 + n * 10**6,
            f"rover/topic{n % TOPICS}",
            body[n % 200 : n % 200 + size],
            attachment=attachment,
            sequence=n,
        )
        for n in range(count)
    ]


def plain_write(path: Path, log: list[Message]) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = {f"rover/topic{n}": writer.register_channel(f"rover/topic{n}", "", 0) for n in range(TOPICS)}
        for message in log:
            channel = channels[message.key]
            writer.add_message(channel, message.time, message.payload, message.time, message.sequence)
        writer.finish()  # type: ignore[no-untyped-call]


def riot_write(path: Path, log: list[Message]) -> None:
    with LogWriter(path) as writer:
        for message in log:
            writer.write(message)


def plain_read(path: Path) -> int:
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file).iter_messages())


def riot_read(path: Path) -> int:
    with LogReader(path) as reader:
        return sum(1 for _ in reader.messages())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--count", type=int, default=50_000)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        plain, ours = Path(folder, "plain.mcap"), Path(folder, "ours.mcap")
        for size, attachment in ((64, None), (200, None), (200, bytes(33)), (10_000, None), (1 << 20, None)):
            count = max(100, min(options.count, options.count * 1000 // size))
            log = messages(count, size, attachment)
            actions: list[tuple[str, Callable[[], object], Callable[[], object]]] = [
                ("write", lambda log=log: plain_write(plain, log), lambda log=log: riot_write(ours, log)),  # type: ignore[misc]
                ("read", lambda: plain_read(plain), lambda: riot_read(ours)),
            ]
            for name, theirs, mine in actions:
                base = rate(theirs, count=count, repeats=options.repeats)
                own = rate(mine, count=count, repeats=options.repeats)
                rows.append(
                    {
                        "action": name,
                        "payload_bytes": size,
                        "attachment_bytes": len(attachment or b""),
                        "mcap_per_second": round(base),
                        "riot_bus_per_second": round(own),
                        "ratio": round(own / base, 2),
                    }
                )
    if options.json:
        print(json.dumps(rows, indent=2))
        return
    print(f"{'action':8}{'payload':>9}{'attachment':>12}{'mcap msg/s':>13}{'riot_bus msg/s':>16}{'ratio':>8}")
    for row in rows:
        print(
            f"{row['action']:8}{row['payload_bytes']:>9}{row['attachment_bytes']:>12}{row['mcap_per_second']:>13,}"
            f"{row['riot_bus_per_second']:>16,}{row['ratio']:>8}"
        )


if __name__ == "__main__":
    main()
