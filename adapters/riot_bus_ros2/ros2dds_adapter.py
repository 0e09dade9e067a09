"""ROS 2 behind zenoh-bridge-ros2dds: the same types as over rmw_zenoh, under keys that are plain names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import ClassVar

from riot_bus.types.capabilities import MOST_TOKENS, Announcement, Identity, Offer, RecordedTopic, SimClock, Stamp
from riot_bus.types.model import MessageType, Schema, TopicName
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_ros2 import ros2dds
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.announcing import announcement_of
from riot_bus_ros2.keys import action_parts, is_topic, is_topic_expression, parse_data_key
from riot_bus_ros2.offering import CLOCK_TOPIC, CLOCK_TYPE, clock_payload, full_name, offer_on, ros_type_of
from riot_bus_ros2.qos import Reliability, RosQos, parse_offered
from riot_bus_ros2.ros2dds import BridgeQos, BridgeToken, request_attachment
from riot_bus_ros2.tokens import profiles_of


class Ros2DdsAdapter(Ros2Adapter):
    """The adapter `ros2dds`; it takes every key for a ROS name, so it is loaded only where it is named.

    Types are those that bridges announce, or those that the user declares.

    Args:
        namespace: Namespace of the bridges, such as `/bot1`.

    Raises:
        ConfigError: The namespace is not valid.
        MissingExtraError: rosbags is not installed.
    """

    name = "ros2dds"
    on_request: ClassVar[bool] = True
    tokens = ros2dds.TOKENS
    services = ()  # keys do not show which are services; Zenoh knows the servers

    def __init__(self, namespace: str = "/") -> None:
        super().__init__()
        if namespace != "/" and not is_topic(namespace):
            raise ConfigError(f"{namespace!r} is not a ROS namespace", where="ros2dds", hint="such as ros2dds:/bot1")
        self._namespace = namespace
        self._announced: dict[str, tuple[str, str | None]] = {}

    def topic(self, key: str) -> TopicName | None:
        """Return `/odom` for `odom`, and the announced type; for a key expression, also the name."""
        name = ros2dds.name_of(key, self._namespace)
        plain = name.replace("$*", "x").replace("**", "x").replace("*", "x")
        return TopicName(name, self._told(key)[0]) if is_topic(plain) else None

    def key_expression(self, topic: str) -> str | None:
        """Return `odom` for `/odom`."""
        return ros2dds.key_of(topic, self._namespace) if is_topic_expression(topic) else None

    def type_of_key(self, key: str) -> MessageType | None:
        """Return the type that was announced for a key, None if it is not known.

        If its hash was announced, too (nodes since Iron), the definition has this hash, or the type is opaque.
        """
        type_name, type_hash = self._told(key)
        if type_name is None:
            return None
        return self.type_named(type_name) if type_hash is None else self._hashed(type_name, type_hash)

    def announcement(self, token: str) -> Announcement | None:
        """Return what a token announces, and remember its type."""
        found = announcement_of(token, namespace=self._namespace)
        if found is not None and found.type_name and len(self._announced) < MOST_TOKENS:
            self._announced[found.key] = found.type_name, self._hash_of(token, found)
            if found.action == found.topic:
                for name, type_name in action_parts(found.action, found.type_name).items():
                    self._announced[ros2dds.key_of(name, self._namespace)] = type_name, None
        return found

    def _told(self, key: str) -> tuple[str | None, str | None]:
        return self._announced.get(key, (None, None))

    def _hash_of(self, token: str, found: Announcement) -> str | None:
        """Return the hash of a key's type from a token, or else from an earlier token with the same type."""
        bridge = ros2dds.parse_bridge_token(token)
        told = None if bridge is None or bridge.qos is None else bridge.qos.type_hash
        former, known = self._announced.get(found.key, ("", None))
        return known if told is None and former == found.type_name else told

    def offer(self, topic: RecordedTopic, *, name: str | None, domain: int | None) -> Offer | None:
        """Return how to publish a topic of a bag, of rmw_zenoh or of a bridge; bridges handle domains."""
        type_name = ros_type_of(topic)
        if type_name is None:
            return None
        rmw = parse_data_key(topic.key) if topic.keyed else None
        recorded = topic.name if rmw is None else rmw.topic
        found = full_name(recorded if name is None else name)
        if not is_topic(found):
            hint = "rename it (--remap) or leave it out (--exclude)"
            raise ConfigError(f"{found!r} is not the name of a ROS topic", hint=hint)
        qos = parse_offered(topic.details.get("offered_qos_profiles", ""))
        return self._offer(found, type_name, qos, topic.details.get("topic_type_hash") or None)

    def server_tokens(self, key: str, zid: str, entity: int) -> Sequence[str]:
        """Return the tokens of a bridge and its service server, if the service's type was announced."""
        type_name, _ = self._told(key)
        if type_name is None or "/srv/" not in type_name:
            return ()
        return _bridge_token(zid), ros2dds.build_bridge_token(BridgeToken(zid, "SS", key, type_name))

    def clock(self, topics: Sequence[RecordedTopic], *, domain: int | None) -> SimClock:
        """Return how to publish `/clock`."""
        qos = RosQos(Reliability.BEST_EFFORT, depth=1)
        offer = self._offer(CLOCK_TOPIC, CLOCK_TYPE, qos, self.store.type_hash(CLOCK_TYPE))
        return SimClock(CLOCK_TOPIC, offer, clock_payload)

    def _request_attachment(self) -> bytes:
        return request_attachment()

    def stamp(self, attachment: bytes) -> Stamp | None:
        """Return None: bridges attach nothing to messages."""
        return None

    def details(self, key: str, tokens: Iterable[str]) -> Mapping[str, str]:
        """Return metadata for a topic's channel in a log: the QoS that its publishers offer, and its type's hash."""
        parsed = (ros2dds.parse_bridge_token(each) for each in sorted(tokens))
        found = [each.qos for each in parsed if each is not None and each.qos and (each.kind, each.key) == ("MP", key)]
        hashes = [each.type_hash for each in found if each.type_hash]
        return {**profiles_of(each.announced for each in found), "topic_type_hash": hashes[0] if hashes else ""}

    def definition(self, key: str) -> tuple[Schema, str] | None:
        """Return the name of a topic's type if it was announced, whether it is known or not."""
        type_name, _ = self._told(key)
        return None if type_name is None else (Schema(type_name, "ros2msg", b""), "cdr")

    def _offer(self, name: str, type_name: str, qos: RosQos, type_hash: str | None) -> Offer:
        key = ros2dds.key_of(name, self._namespace)
        announced = BridgeQos.of(qos, type_hash=type_hash)
        return offer_on(key, qos, partial(_identity, BridgeToken("", "MP", key, type_name, announced)))


def _identity(token: BridgeToken, zid: str, entity: int) -> Identity:
    own = BridgeToken(zid, token.kind, token.key, token.type_name, token.qos)
    return Identity((_bridge_token(zid), ros2dds.build_bridge_token(own)), lambda recorded, sequence, time: None)


def _bridge_token(zid: str) -> str:
    return f"@/{zid}/@ros2_lv"
