"""A node of real ROS 2 in a process of its own, driven by JSON lines; runs in the environment of `tests.ros2_env`."""

from __future__ import annotations

import contextlib
import json
import select
import subprocess
import sys
from pathlib import Path
from typing import Any, Self

ANSWER_S = 60
RELIABLE = {"reliability": 1, "durability": 2, "depth": 1000}
BEST_EFFORT = {"reliability": 2, "durability": 2, "depth": 1000}
LATCHED = {"reliability": 1, "durability": 1, "depth": 5}


class RclpyNode:
    """The test's end of a node.

    Args:
        python: Interpreter that has rclpy.
        environment: Of `ros2_environment`.
        name: Name of the ROS node.
        namespace: Its namespace.
    """

    def __init__(self, python: Path, environment: dict[str, str], name: str, namespace: str = "") -> None:
        self.process = subprocess.Popen(
            [python, __file__, name, namespace],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        assert self._answer() == name

    def do(self, do: str, topic: str = "", **arguments: Any) -> Any:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps({"do": do, "topic": topic, **arguments}) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], ANSWER_S)
        line = self.process.stdout.readline() if ready else ""
        assert line, "node does not answer"
        return json.loads(line)

    def end(self) -> None:
        """Leave the domain as a node does that ends by itself."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        assert self.process.wait(60) == 0

    def close(self) -> None:
        self.process.kill()
        self.process.wait(60)
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _main(name: str, namespace: str) -> None:
    import importlib
    import threading
    import time

    import rclpy
    from rclpy.action import ActionClient, ActionServer
    from rclpy.duration import Duration
    from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    rclpy.init()
    node = rclpy.create_node(name, namespace=namespace)
    executor = MultiThreadedExecutor(4)
    executor.add_node(node)
    arrived = threading.Condition()
    publishers: dict[str, Any] = {}
    subscriptions: dict[str, Any] = {}
    received: dict[str, list[str]] = {}
    keep: list[Any] = []

    def kind_of(text: str) -> Any:
        package, kind, short = text.split("/")
        return getattr(importlib.import_module(f"{package}.{kind}"), short)

    def profile(qos: dict[str, int]) -> Any:
        more = {"deadline": Duration(nanoseconds=qos["deadline"])} if "deadline" in qos else {}
        return QoSProfile(
            reliability=ReliabilityPolicy(qos["reliability"]),
            durability=DurabilityPolicy(qos["durability"]),
            depth=qos["depth"],
            **more,
        )

    def spin() -> None:
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    def wait(future: Any) -> Any:
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        return future.result() if done.wait(ANSWER_S / 2) else None

    def run(order: dict[str, Any]) -> Any:
        topic = order["topic"]
        match order["do"]:
            case "advertise":
                publishers[topic] = node.create_publisher(kind_of(order["type"]), topic, profile(order["qos"]))
            case "publish":
                for payload in order["payloads"]:
                    publishers[topic].publish(bytes.fromhex(payload))
            case "acknowledged":
                # asked again each second, in case that a long wait misses its end; otherwise it is told who has not
                deadline = time.monotonic() + ANSWER_S / 2
                while not publishers[topic].wait_for_all_acked(Duration(seconds=1)):
                    if time.monotonic() > deadline:
                        matched = publishers[topic].get_subscription_count()
                        readers = node.get_subscriptions_info_by_topic(topic)
                        return f"not by all of {matched}: {[(each.node_name, each.endpoint_gid) for each in readers]}"
                return "yes"
            case "matched":
                return publishers[topic].get_subscription_count()
            case "subscribe":
                found = received.setdefault(topic, [])

                def take(payload: bytes) -> None:
                    with arrived:
                        found.append(payload.hex())
                        arrived.notify_all()

                subscriptions[topic] = node.create_subscription(
                    kind_of(order["type"]), topic, take, profile(order["qos"]), raw=True
                )
            case "unsubscribe":
                node.destroy_subscription(subscriptions.pop(topic))
            case "wait":
                with arrived:
                    arrived.wait_for(lambda: len(received[topic]) >= order["count"], order.get("seconds", 30))
                    return received[topic]
            case "offers":
                return [
                    [each.node_name, each.topic_type, int(each.qos_profile.reliability),
                     int(each.qos_profile.durability), each.qos_profile.deadline.nanoseconds]
                    for each in node.get_publishers_info_by_topic(topic)
                ]  # fmt: skip
            case "names":
                return [
                    sorted(dict(node.get_topic_names_and_types())),
                    sorted(dict(node.get_service_names_and_types())),
                ]
            case "serve":

                def answer(request: Any, response: Any) -> Any:
                    time.sleep(order.get("seconds", 0.0))  # a slow server
                    response.success, response.message = not request.data, f"served by {name}: {request.data}"
                    return response

                keep.append(node.create_service(kind_of("std_srvs/srv/SetBool"), topic, answer))
            case "call":
                client = node.create_client(kind_of("std_srvs/srv/SetBool"), topic)
                if not client.wait_for_service(ANSWER_S / 2):
                    return "no server"
                response = wait(client.call_async(kind_of("std_srvs/srv/SetBool").Request(data=order["data"])))
                node.destroy_client(client)
                return None if response is None else [response.success, response.message]
            case "serve_action":
                action = kind_of("test_msgs/action/Fibonacci")

                def execute(goal: Any) -> Any:
                    numbers = [0, 1]
                    for _ in range(goal.request.order):
                        numbers.append(numbers[-1] + numbers[-2])
                        goal.publish_feedback(action.Feedback(sequence=numbers))
                    goal.succeed()
                    return action.Result(sequence=numbers)

                keep.append(ActionServer(node, action, topic, execute))
            case "act":
                action = kind_of("test_msgs/action/Fibonacci")
                client = ActionClient(node, action, topic)
                if not client.wait_for_server(ANSWER_S / 2):
                    return "no server"
                heard: list[Any] = []
                goal = wait(
                    client.send_goal_async(
                        action.Goal(order=order["order"]),
                        feedback_callback=lambda message: heard.append(list(message.feedback.sequence)),
                    )
                )
                result = wait(goal.get_result_async())
                client.destroy()
                return [list(result.result.sequence), result.status, heard]
            case other:
                raise ValueError(other)
        return None

    thread = threading.Thread(target=spin)
    thread.start()
    print(json.dumps(name), flush=True)
    for line in sys.stdin:
        print(json.dumps(run(json.loads(line))), flush=True)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    thread.join()


if __name__ == "__main__":
    _main(*sys.argv[1:])
