"""How a recorded ROS topic is published over rmw_zenoh: key, latching, liveliness tokens and attachments.

Source: docs/design.md, liveliness_utils.cpp and attachment_helpers.cpp of ros2/rmw_zenoh.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from riot_bus.types.capabilities import Identity, Offer, RecordedTopic, SimClock
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus_ros2.attachment import Attachment, build_attachment, parse_attachment
from riot_bus_ros2.definitions import normal_name
from riot_bus_ros2.gid import gid_of
from riot_bus_ros2.keys import DataKey, build_data_key, is_topic, parse_data_key
from riot_bus_ros2.qos import USUAL_DEPTH, Reliability, RosQos, parse_offered
from riot_bus_ros2.tokens import Node, NodeEndpoint, build_token

NODE = "riot_play"
"""Name of the ROS node that a player appears as."""

CLOCK_TOPIC, CLOCK_TYPE = "/clock", "rosgraph_msgs/msg/Clock"
_HASH = re.compile(r"RIHS[0-9]{2}_[0-9a-f]+")
_TYPE = re.compile(r"[A-Za-z]\w*/(msg|srv|action)/[A-Za-z]\w*", re.ASCII)
_SCHEMAS = ("ros2msg", "ros2idl")
_LARGEST_DOMAIN = 999_999_999  # data keys have domains of up to nine digits (keys.py)


def offer_of(
    topic: RecordedTopic,
    *,
    name: str | None,
    domain: int | None,
    type_hash: Callable[[RecordedTopic, str], str | None],
) -> Offer | None:
    """Return how to publish a topic, None if it is not a ROS topic.

    Args:
        domain: Another ROS domain; by default that of the key, else that of `ROS_DOMAIN_ID`, else 0.
        type_hash: Returns the hash of a type that the bag does not contain.
    """
    if domain is not None and not 0 <= domain <= _LARGEST_DOMAIN:
        raise ConfigError(f"{domain} is not a ROS domain", hint="give a number such as 0")
    found = parse_data_key(topic.key) if topic.keyed else _bag_key(topic, type_hash)
    if found is None:
        return None
    found = replace(
        found,
        topic=found.topic if name is None else full_name(name),
        domain=found.domain if domain is None else domain,
        suffix="",  # buffers were meant for a subscriber that is gone; ours takes messages from the topic itself
    )
    if not is_topic(found.topic):
        raise ConfigError(
            f"{found.topic!r} is not the name of a ROS topic", hint="rename it (--remap) or leave it out (--exclude)"
        )
    qos = parse_offered(topic.details.get("offered_qos_profiles", ""))
    return _offer(found, qos)


def clock_of(topics: Sequence[RecordedTopic], *, domain: int | None, type_hash: str) -> SimClock:
    """Return how to publish `/clock`.

    Args:
        topics: The played topics; their subscribers use the same domain and the same form of type names.
    """
    keys = (parse_data_key(topic.key) for topic in topics if topic.keyed)
    example = next((key for key in keys if key is not None), None)
    if domain is None:
        domain = _default_domain() if example is None else example.domain
    hashed = example is None or example.type_hash is not None  # Humble has no hashes
    key = DataKey(domain, CLOCK_TOPIC, CLOCK_TYPE, type_hash if hashed else None)
    return SimClock(CLOCK_TOPIC, _offer(key, RosQos(Reliability.BEST_EFFORT, depth=1)), clock_payload)


def identity_of(key: DataKey, qos: RosQos, zid: str, entity: int) -> Identity:
    """Return the tokens of the node and of the publisher, and the function that makes its attachments.

    Args:
        entity: Number of the publisher in it, from 1; the node is number 0.
    """
    node = Node(key.domain, zid, 0, f"/{NODE}")
    endpoint = NodeEndpoint(node, entity, "MP", key.topic, key.type_name, key.type_hash, qos)
    publisher = build_token(endpoint)
    return Identity((build_token(node), publisher), partial(_attachment, gid_of(publisher)))


def server_tokens(key: DataKey, zid: str, entity: int) -> Sequence[str]:
    """Return the tokens of the node and of a service server; arguments are those of `identity_of`."""
    node = Node(key.domain, zid, 0, f"/{NODE}")
    qos = RosQos(depth=USUAL_DEPTH)
    server = NodeEndpoint(node, entity, "SS", key.topic, key.type_name, key.type_hash, qos)
    return build_token(node), build_token(server)


def _offer(key: DataKey, qos: RosQos) -> Offer:
    return offer_on(build_data_key(key), qos, partial(identity_of, key, qos))


def offer_on(key: str, qos: RosQos, identify: Callable[[str, int], Identity]) -> Offer:
    """Return how to publish on a key with a QoS.

    Args:
        identify: Returns tokens and attachments for the id of a Zenoh session and the number of the publisher in it.
    """
    return Offer(
        key,
        depth=qos.kept if qos.latched else None,
        reliable=qos.reliable,
        block=qos.reliable and qos.keep_all,
        identify=identify,
    )


def ros_type_of(topic: RecordedTopic) -> str | None:
    """Return the type of a recorded topic, such as `nav_msgs/msg/Odometry`, None if it is not a ROS 2 type."""
    type_name = normal_name(topic.schema.name)
    known = topic.encoding == "cdr" and topic.schema.encoding in _SCHEMAS and _TYPE.fullmatch(type_name) is not None
    return type_name if known else None


def _bag_key(topic: RecordedTopic, type_hash: Callable[[RecordedTopic, str], str | None]) -> DataKey | None:
    type_name = ros_type_of(topic)
    if type_name is None:
        return None
    recorded = topic.details.get("topic_type_hash", "")
    found = recorded if _HASH.fullmatch(recorded) else type_hash(topic, type_name)
    return DataKey(_default_domain(), full_name(topic.name), type_name, found)


def _default_domain() -> int:
    text = os.environ.get("ROS_DOMAIN_ID", "")
    if not text:
        return 0
    if not text.isdecimal() or int(text) > _LARGEST_DOMAIN:
        raise ConfigError(f"{text!r} is not a ROS domain", where="ROS_DOMAIN_ID", hint="set it to a number such as 0")
    return int(text)


def full_name(name: str) -> str:
    """Return a topic name of a bag with its leading slash."""
    return name if name.startswith("/") else f"/{name}"


def _attachment(gid: bytes, recorded: bytes | None, sequence: int, time: int) -> bytes:
    attachment = Attachment(sequence, time, gid)
    if recorded is not None:
        try:
            attachment = attachment._replace(version=parse_attachment(recorded).version)
        except PayloadError:
            return recorded  # it was corrupted on purpose
    return build_attachment(attachment)


def clock_payload(time: int) -> bytes:
    """Return a rosgraph_msgs/msg/Clock of a time in nanoseconds."""
    seconds, nanoseconds = divmod(max(0, time), 10**9)
    return b"\0\1\0\0" + struct.pack("<iI", min(seconds, 2**31 - 1), nanoseconds)
