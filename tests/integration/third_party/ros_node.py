"""A ROS 2 node without ROS: zenoh-ros2-sdk, driven by JSON lines; runs in an environment of its own.

The SDK would download message definitions with git; here they are given, so that no network is needed.
"""

from __future__ import annotations

import json
import sys
import threading
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

DEFINITIONS = {
    "geometry_msgs/msg/Twist.msg": "Vector3 linear\nVector3 angular\n",
    "geometry_msgs/msg/Vector3.msg": "float64 x\nfloat64 y\nfloat64 z\n",
    "std_msgs/msg/String.msg": "string data\n",
}
SERVICE = "example_interfaces/srv/AddTwoInts"
REQUEST, RESPONSE = "int64 a\nint64 b", "int64 sum"
LATCHED = ":1:,10:,:,:,,"
"""Quality of service as rmw_zenoh writes it: transient local, keep the last 10."""


def plain(message: Any) -> Any:
    """Return a message's fields as the test writes them."""
    if isinstance(message, list):
        return [plain(each) for each in message]
    if not is_dataclass(message):
        return message.tolist() if hasattr(message, "tolist") else message
    return {each.name: plain(getattr(message, each.name)) for each in fields(message) if each.name != "__msgtype__"}


def found(values: Any, path: str) -> Any:
    """Return the field of a message that a path such as `poses.0.x` names."""
    for part in path.split("."):
        values = values[int(part) if isinstance(values, list) else part]
    return values


def main(port: int, folder: Path, name: str) -> None:
    import numpy
    import zenoh_ros2_sdk as sdk

    def define(definitions: dict[str, str]) -> None:
        for path, text in definitions.items():
            file = folder / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)

    define(DEFINITIONS)
    session = sdk.ZenohSession.get_instance("127.0.0.1", port)
    sdk.get_registry().messages_dir = folder
    common: dict[str, Any] = {"node_name": name, "router_ip": "127.0.0.1", "router_port": port}
    service = {"srv_type": SERVICE, "request_definition": REQUEST, "response_definition": RESPONSE, **common}
    publishers: dict[str, Any] = {}
    servers: list[Any] = []
    subscribers: list[Any] = []
    received: list[list[Any]] = []
    arrived = threading.Condition()

    def collect(topic: str) -> Any:
        def take(message: Any) -> None:
            with arrived:
                received.append([topic, plain(message)])
                arrived.notify()

        return take

    def filled(values: dict[str, Any], types: dict[str, str], path: str = "") -> dict[str, Any]:
        result = {}
        for each, value in values.items():
            inner = f"{path}.{each}".strip(".")
            if isinstance(value, dict):
                kind = sdk.get_message_class(types.get(inner, "geometry_msgs/msg/Vector3"))
                result[each] = kind(**filled(value, types, inner))
            elif isinstance(value, list) and all(isinstance(one, float) for one in value):
                result[each] = numpy.array(value, dtype=numpy.float64)
            else:
                result[each] = value
        return result

    def add(request: Any) -> Any:
        return servers[0].response_msg_class(sum=request.a + request.b)

    def run(order: dict[str, Any]) -> Any:
        topic = order.get("topic", "")
        kind = order.get("type", "std_msgs/msg/String")
        endpoint = {"topic": topic, "msg_type": kind, "domain_id": order.get("domain", 0), **common}
        match order["do"]:
            case "advertise":
                publishers[topic] = sdk.ROS2Publisher(**endpoint)
                return publishers[topic].keyexpr
            case "publish":
                for values in order["messages"]:
                    publishers[topic].publish(**filled(values, order.get("types", {})))
            case "subscribe":
                qos = LATCHED if order.get("latched") else None
                subscribers.append(sdk.ROS2Subscriber(callback=collect(topic), qos=qos, **endpoint))
            case "define":
                define(order["definitions"])
            case "values":
                with arrived:
                    return [
                        [found(values, path) for path in order["paths"]] for where, values in received if where == topic
                    ]
            case "count":
                with arrived:
                    return sum(where == topic for where, _ in received)
            case "wait":
                with arrived:
                    arrived.wait_for(lambda: sum(each[0] == topic for each in received) >= order["count"], 30)
                    return [values for where, values in received if where == topic]
            case "received":
                with arrived:
                    return [values for where, values in received if where == topic]
            case "serve":
                servers.append(sdk.ROS2ServiceServer(topic, callback=add, **service))
            case "ask":
                servers.append(sdk.ROS2ServiceClient(topic, **service))
            case "call":
                client = sdk.ROS2ServiceClient(topic, timeout=order.get("timeout", 30.0), **service)
                answer = client.call(a=order["a"], b=order["b"])
                client.close()
                return None if answer is None else answer.sum
            case "topics":
                return dict(sdk.get_topic_names_and_types(router_ip="127.0.0.1", router_port=port))
            case "services":
                return dict(sdk.get_service_names_and_types(router_ip="127.0.0.1", router_port=port))
            case other:
                raise ValueError(other)
        return None

    print(json.dumps(session.session_id), flush=True)
    for line in sys.stdin:
        print(json.dumps(run(json.loads(line))), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
