"""Runs the node of a case in the case's own environment: `serve.py CASE ENDPOINT [--checked]`, or `serve.py CASE -`.

With an endpoint the node is a program on the bus as people write them: JSON in, JSON out, and what a handler raises
ends it, unless its module names the error in `REFUSED`. With `-` there is no bus: each line on stdin is a log, of which
each input is `[seconds, topic, fields]`; each runs in a process of its own, and a line on stdout says how that ended.
"""

from __future__ import annotations

import importlib
import json
import os
import queue
import select
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

PATIENCE_S = 5.0  # for a log that takes milliseconds, beyond the time that its inputs take


def module_of(case: str) -> ModuleType:
    """Import the file node.py of a case."""
    sys.path.insert(0, case)
    return importlib.import_module("node")


def handle(module: ModuleType, handler: Callable[[Any], None], fields: Any) -> None:
    """Call a handler; what the program refuses on purpose is said and passed over."""
    try:
        handler(fields)
    except getattr(module, "REFUSED", ()) as error:
        print(f"refused: {error}", file=sys.stderr, flush=True)


def on_the_bus(module: ModuleType, endpoint: str, *, checked: bool) -> None:
    """Be a program on the bus, until it is ended."""
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    arrived: queue.SimpleQueue[Any] = queue.SimpleQueue()
    handlers = module.node(lambda topic, fields: session.put(topic, json.dumps(fields).encode()), checked)
    subscribers = [session.declare_subscriber(topic, arrived.put) for topic in handlers]
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    while subscribers:
        sample = arrived.get()
        handle(module, handlers[str(sample.key_expr)], json.loads(sample.payload.to_bytes()))


def play(module: ModuleType, log: Sequence[Any], tell: Callable[[dict[str, Any]], None], *, checked: bool) -> None:
    """Feed a log to a new node; tell what it publishes."""
    lock = threading.Lock()

    def publish(topic: str, fields: Any) -> None:
        with lock:  # nodes may have threads
            tell({"topic": topic, "fields": fields})

    handlers = module.node(publish, checked)
    begin = time.monotonic()
    for seconds, topic, fields in log:
        if getattr(module, "PACED", False):
            time.sleep(max(0.0, begin + seconds - time.monotonic()))
        handle(module, handlers[topic], fields)
        tell({"handled": topic})
    if getattr(module, "PACED", False):
        time.sleep(0.5)  # for what the node's own threads still do


def place_of(error: BaseException) -> str:
    """Return file and line of the innermost frame."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{frame.filename}:{frame.lineno}"


def tried(module: ModuleType, log: Sequence[Any], *, checked: bool) -> dict[str, Any]:
    """Run a log in a process of its own; return its end, its outputs, and the error if there was one."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        os.dup2(2, 1)  # what libraries print is not an answer

        def send(line: dict[str, Any]) -> None:
            os.write(writing, json.dumps(line).encode() + b"\n")

        try:
            play(module, log, send, checked=checked)
            send({"end": "passed"})
        except BaseException as error:
            send({"end": "raised", "error": f"{type(error).__name__}: {error}"[:300], "place": place_of(error)})
        os._exit(0)
    os.close(writing)
    length = log[-1][0] - log[0][0] if log and getattr(module, "PACED", False) else 0.0
    deadline, data, status = time.monotonic() + PATIENCE_S + length, b"", None
    while (left := deadline - time.monotonic()) > 0:
        if select.select([reading], [], [], left)[0]:
            more = os.read(reading, 1 << 16)
            if not more:
                break
            data += more
    else:
        os.kill(child, signal.SIGKILL)
        status = "hung"
    code = os.waitpid(child, 0)[1]
    os.close(reading)
    lines = [json.loads(line) for line in data.splitlines()]
    found = next((line for line in lines if "end" in line), {"end": status or f"signal {os.WTERMSIG(code)}"})
    outputs = [(line["topic"], line["fields"]) for line in lines if "topic" in line]
    return found | {"outputs": outputs, "handled": sum("handled" in line for line in lines)}


def main() -> None:
    """Carry out the command line."""
    case, endpoint, *options = sys.argv[1:]
    module = module_of(case)
    if endpoint != "-":
        on_the_bus(module, endpoint, checked="--checked" in options)
    for line in sys.stdin:
        print(json.dumps(tried(module, json.loads(line), checked="--checked" in options)), flush=True)


if __name__ == "__main__":
    main()
