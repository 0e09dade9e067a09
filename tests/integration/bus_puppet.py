"""A component for tests: a process of its own with a plain Zenoh session, driven by JSON lines."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from typing import Any


class Puppet:
    """The test's end of a puppet process."""

    def __init__(self, endpoint: str, *, mode: str = "client", config: dict[str, Any] | None = None) -> None:
        self.process = subprocess.Popen(
            [sys.executable, __file__, endpoint, mode, json.dumps(config or {})],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.zid = self._answer()

    def start(self, do: str, **arguments: Any) -> None:
        """Send a command without waiting for its answer."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps({"do": do, **arguments}) + "\n")
        self.process.stdin.flush()

    def do(self, do: str, **arguments: Any) -> Any:
        self.start(do, **arguments)
        return self._answer()

    def _answer(self) -> Any:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, f"puppet ended with {self.process.wait(60)}"
        return json.loads(line)

    answer = _answer

    def alive(self) -> bool:
        return self.process.poll() is None

    def pause(self) -> None:
        """Stop the process, all its threads: from now on it takes nothing from its sockets."""
        self.process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, self.process.pid, os.WSTOPPED | os.WNOWAIT)

    def go_on(self) -> None:
        self.process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(60)
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()

    def __enter__(self) -> Puppet:
        return self

    def __exit__(self, *error: object) -> None:
        self.kill()


def _main(endpoint: str, mode: str, more: str) -> None:
    import itertools
    import os
    import threading
    import time

    import zenoh
    from zenoh import ext

    config = zenoh.Config()
    settings = {
        "mode": mode,
        "connect/endpoints": [endpoint],
        "scouting/delay": 0,
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
        **json.loads(more),
    }
    if mode == "peer":
        settings["listen/endpoints"] = ["tcp/127.0.0.1:0"]
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    received: list[zenoh.Sample] = []
    numbers: list[int] = []
    by_key: dict[str, list[tuple[int, float]]] = {}
    streaming = threading.Event()
    streams: dict[str, threading.Thread] = {}
    sent: dict[str, int] = {}
    arrived = threading.Condition()
    keep: list[Any] = []

    def collect(sample: zenoh.Sample) -> None:
        with arrived:
            received.append(sample)
            arrived.notify()

    def number(sample: zenoh.Sample) -> None:
        numbers.append(int.from_bytes(bytes(sample.payload)[:8], "little"))
        if len(numbers) % 1000 == 0:
            with arrived:
                arrived.notify()

    def numbered(sample: zenoh.Sample) -> None:
        number = int.from_bytes(bytes(sample.payload)[:8], "little")
        by_key.setdefault(str(sample.key_expr), []).append((number, time.monotonic()))

    def stream(publisher: zenoh.Publisher, key: str, interval: float) -> None:
        while streaming.is_set():
            publisher.put(sent[key].to_bytes(8, "little") + bytes(56))
            sent[key] += 1
            time.sleep(interval)

    def qos(order: dict[str, Any]) -> dict[str, Any]:
        return {
            "priority": getattr(zenoh.Priority, order.get("priority", "DATA")),
            "congestion_control": getattr(zenoh.CongestionControl, order.get("congestion", "DROP")),
            "express": order.get("express", False),
        }

    def attachment(order: dict[str, Any]) -> bytes | None:
        return bytes.fromhex(order["attachment"]) if "attachment" in order else None

    def show(sample: zenoh.Sample) -> dict[str, Any]:
        return {
            "key": str(sample.key_expr),
            "payload": bytes(sample.payload).hex(),
            "kind": str(sample.kind),
            "encoding": str(sample.encoding),
            "attachment": None if sample.attachment is None else bytes(sample.attachment).hex(),
            "priority": int(sample.priority),  # type: ignore[call-overload]
            "congestion": int(sample.congestion_control),  # type: ignore[call-overload]
            "express": sample.express,
        }

    def run(order: dict[str, Any]) -> Any:
        key = order.get("key", "")
        match order["do"]:
            case "subscribe":
                keep.append(session.declare_subscriber(key, collect))
            case "subscribe_numbers":
                keep.append(session.declare_subscriber(key, number))
            case "subscribe_by_key":
                keep.append(session.declare_subscriber(key, numbered))
            case "by_key":
                report = {}
                for name, entries in list(by_key.items()):
                    found, times = [each for each, _ in entries], [at for _, at in entries]
                    gaps = [b - a for a, b in itertools.pairwise(times)]
                    report[name] = {
                        "count": len(found),
                        "different": len(set(found)),
                        "ordered": found == sorted(found),
                        "last": found[-1],
                        "gap": max(gaps, default=0.0),
                    }
                return report
            case "subscribe_advanced":
                keep.append(
                    ext.declare_advanced_subscriber(
                        session,
                        key,
                        collect,
                        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=10),
                        recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                    )
                )
            case "publish_advanced":
                keep.append(
                    ext.declare_advanced_publisher(
                        session,
                        key,
                        cache=ext.CacheConfig(order.get("depth", 10)),
                        sample_miss_detection=ext.MissDetectionConfig(heartbeat=0.05, sporadic_heartbeat=None),
                        publisher_detection=True,
                    )
                )
                for text in order["payloads"]:
                    keep[-1].put(text)
            case "put":
                payload = bytes.fromhex(order.get("payload", ""))
                encoding = order.get("encoding")
                session.put(key, payload, encoding=encoding, attachment=attachment(order), **qos(order))
            case "put_texts":
                for text in order["payloads"]:
                    session.put(key, text, **qos(order))
            case "delete":
                session.delete(key, attachment=attachment(order), **qos(order))
            case "declare":
                keep.append(session.declare_publisher(key))
            case "flood":
                order.setdefault("congestion", "BLOCK")
                publisher = session.declare_publisher(key, **qos(order))
                padding = os.urandom if order.get("noise") else bytes  # noise cannot be compressed
                for index in range(order["count"]):
                    publisher.put(index.to_bytes(8, "little") + padding(order.get("padding", 56)))
            case "crowd":  # many components, each of which floods
                crowd = [zenoh.open(config) for _ in range(order["sessions"])]
                keep.extend(crowd)
                order.setdefault("congestion", "BLOCK")
                publishers = [
                    each.declare_publisher(f"{key}/{order['first'] + place}", **qos(order))
                    for place, each in enumerate(crowd)
                ]

                def flood(publisher: zenoh.Publisher) -> None:
                    for index in range(order["count"]):
                        publisher.put(index.to_bytes(8, "little") + bytes(order.get("padding", 1000)))

                threads = [threading.Thread(target=flood, args=(each,)) for each in publishers]
                for each in threads:
                    each.start()
                for each in threads:
                    each.join()
            case "flood_keys":
                for index in range(order["first"], order["first"] + order["count"]):
                    session.put(f"{key}/{index}", b"x", **qos(order))
            case "stream":
                streaming.set()
                sent[key] = 0
                order.setdefault("congestion", "BLOCK")
                publisher = session.declare_publisher(key, **qos(order))
                streams[key] = threading.Thread(target=stream, args=(publisher, key, order["interval"]), daemon=True)
                streams[key].start()
            case "stop_streams":
                streaming.clear()
                for each in streams.values():
                    each.join(60)
                return sent
            case "wait":
                with arrived:
                    arrived.wait_for(lambda: len(received) >= order["count"], order.get("timeout", 60))
                    return [show(sample) for sample in received]
            case "wait_numbers":
                with arrived:
                    arrived.wait_for(lambda: len(numbers) >= order["count"], order.get("timeout", 60))
                return {"count": len(numbers), "ordered": numbers == sorted(numbers), "different": len(set(numbers))}
            case "queryable":

                def reply(query: zenoh.Query) -> None:
                    with query:
                        query.reply(query.key_expr, query.payload or b"none")

                keep.append(session.declare_queryable(key, reply))
            case "get":
                return [bytes(r.ok.payload).hex() for r in session.get(key, payload=b"ask", timeout=60) if r.ok]
            case "token":
                keep.append(session.liveliness().declare_token(key))
            case "tokens":
                keep.append(session.liveliness().declare_subscriber(key, collect, history=True))
            case other:
                raise ValueError(other)
        return None

    print(json.dumps(str(session.info.zid())), flush=True)
    for line in sys.stdin:
        print(json.dumps(run(json.loads(line))), flush=True)


if __name__ == "__main__":
    _main(*sys.argv[1:])
