"""The ROS 2 nodes that `benchmarks/ros2_bridge.py` starts, in the Python that has rclpy; imports nothing of ours.

`ros2_bridge_ends.py ROLE COUNTER`: a talker, a listener, or a relay between two domains. Orders come as lines of JSON
on stdin, each is answered by one on stdout. The listener counts in the mapped file COUNTER, which the talker looks at.
"""

from __future__ import annotations

import json
import mmap
import os
import statistics
import struct
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import String

if TYPE_CHECKING:
    from collections.abc import Callable

TOPIC = "/stream"
NO_LIMIT = 20_000
DEPTH = int(os.environ.get("DEPTH", NO_LIMIT))
WAIT_NS = 100_000_000
IDLE_S = 0.0002
_HEAD = struct.Struct("<4sIq")
_COUNT = struct.Struct("<q")


def message(size: int) -> bytes:
    """Return a serialized String of about this many bytes, whose text begins with the present time."""
    return _HEAD.pack(b"\0\1\0\0", size - 8, time.time_ns()) + bytes(size - _HEAD.size)


def counter(path: str) -> mmap.mmap:
    """Return the mapped counter."""
    with Path(path).open("r+b") as file:
        return mmap.mmap(file.fileno(), _COUNT.size)


class Talker:
    """Publishes.

    Args:
        count: What the listener has got.
    """

    def __init__(self, count: mmap.mmap) -> None:
        self._count = count
        self._node = Node("talker")
        self._publisher = self._node.create_publisher(String, TOPIC, QoSProfile(depth=NO_LIMIT))

    def matched(self) -> int:
        """Return how many subscriptions there are."""
        return int(self._publisher.get_subscription_count())

    def flow(self, seconds: float, size: int, window: int) -> int:
        """Publish as fast as messages arrive, with at most so many on their way; return how many."""
        sent, publish, payload = 0, self._publisher.publish, message(size)
        arrived = begun = _COUNT.unpack_from(self._count)[0]
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            arrived = _COUNT.unpack_from(self._count)[0] - begun
            if sent - arrived >= window:
                time.sleep(IDLE_S)
                continue
            for _ in range(min(64, window - (sent - arrived))):
                publish(payload)
                sent += 1
        return sent

    def burst(self, count: int, size: int) -> float:
        """Publish at once; return how many seconds that took."""
        publish, payload, began = self._publisher.publish, message(size), time.monotonic()
        for _ in range(count):
            publish(payload)
        return time.monotonic() - began

    def pace(self, count: int, rate: float, size: int) -> int:
        """Publish at a steady rate."""
        began = time.monotonic()
        for number in range(count):
            time.sleep(max(0.0, began + number / rate - time.monotonic()))
            self._publisher.publish(message(size))
        return count


class Listener:
    """Takes messages, without an executor's cost.

    Args:
        count: Where to count.
    """

    def __init__(self, count: mmap.mmap) -> None:
        self._count, self._number = count, 0
        self._delays: list[int] = []
        self._last = 0.0
        node = Node("listener")
        self._subscription: Any = node.create_subscription(
            String, TOPIC, lambda _: None, QoSProfile(depth=DEPTH), raw=True
        )
        self._node = node
        threading.Thread(target=self._spin, daemon=True).start()

    def reset(self) -> int:
        """Forget delays; return how many messages there were until now."""
        self._delays = []
        return self._number

    def report(self) -> dict[str, float]:
        """Return what was seen."""
        delays = sorted(self._delays) or [0]
        return {
            "count": self._number,
            "last": self._last,
            "p50": statistics.median(delays) / 1e3,
            "p99": delays[min(len(delays) - 1, int(0.99 * len(delays)))] / 1e3,
        }

    def _spin(self) -> None:
        handle = self._subscription.handle
        wait_set: Any = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, rclpy.get_default_context().handle)
        while rclpy.ok():
            wait_set.clear_entities()
            wait_set.add_subscription(handle)
            wait_set.wait(WAIT_NS)
            while (taken := handle.take_message(String, True)) is not None:  # noqa: FBT003 - rclpy takes no names here
                now = time.time_ns()
                self._delays.append(now - _HEAD.unpack_from(taken[0])[2])
                self._number += 1
                _COUNT.pack_into(self._count, 0, self._number)
                self._last = time.monotonic()


class Relay:
    """What one would write first: a node in each domain, and a callback that publishes what the other one takes."""

    def __init__(self, domains: tuple[int, int]) -> None:
        contexts = [Context(), Context()]
        for context, domain in zip(contexts, domains, strict=True):
            context.init(domain_id=domain)
        one, other = (Node("relay", context=context, enable_rosout=False) for context in contexts)
        publisher = other.create_publisher(String, TOPIC, QoSProfile(depth=DEPTH))
        one.create_subscription(String, TOPIC, publisher.publish, QoSProfile(depth=DEPTH), raw=True)
        executor = SingleThreadedExecutor(context=contexts[0])
        executor.add_node(one)
        self._keep = other
        threading.Thread(target=executor.spin, daemon=True).start()


def main(role: str, path: str) -> None:
    """Carry out orders until stdin ends."""
    if role == "relay":
        end: Any = Relay((int(os.environ["ROS_DOMAIN_ID"]), int(path)))
    else:
        rclpy.init()
        end = (Talker if role == "talker" else Listener)(counter(path))
    print(json.dumps("ready"), flush=True)
    for line in sys.stdin:
        order = json.loads(line)
        do: Callable[..., Any] = getattr(end, order.pop("do"))
        print(json.dumps(do(**order)), flush=True)
    os._exit(0)  # rclpy's threads are still there


if __name__ == "__main__":
    main(*sys.argv[1:])
