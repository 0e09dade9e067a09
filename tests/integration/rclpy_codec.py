"""Run by a Python that has rclpy: takes each payload apart and puts it together again, as real ROS 2 does.

Standard input has a line for each: the type's name and the payload in hexadecimal; so has standard output.
"""

import sys
from importlib import import_module

from rclpy.serialization import deserialize_message, serialize_message


def class_of(name):
    package, kind, short = name.split("/")
    short, *parts = short.split("_")
    found = getattr(import_module(f"{package}.{kind}"), short)
    services = {"SendGoal": "SendGoalService", "GetResult": "GetResultService", "FeedbackMessage": "FeedbackMessage"}
    if parts and parts[0] in services:
        found = getattr(found.Impl, services[parts.pop(0)])
    for part in parts:
        found = getattr(found, part)
    return found


for line in sys.stdin:
    name, payload = line.split()
    kind = class_of(name)
    print(name, serialize_message(deserialize_message(bytes.fromhex(payload), kind)).hex())
