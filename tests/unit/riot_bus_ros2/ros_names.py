"""Hypothesis strategies for what ROS 2 names and announces."""

from __future__ import annotations

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from riot_bus_ros2.keys import DataKey
from riot_bus_ros2.qos import RosQos
from riot_bus_ros2.ros2dds import BridgeQos, BridgeToken
from riot_bus_ros2.tokens import Node, NodeEndpoint

relaxed = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""For machines under load."""

words = st.text(st.sampled_from("abcXYZ_"), min_size=1, max_size=6) | st.sampled_from(["odom", "robot_1", "a0"])
hexes = st.integers(1, 2**128 - 1).map("{:x}".format)
names = st.lists(words, min_size=1, max_size=4).map(lambda chunks: "/" + "/".join(chunks))
type_names = st.builds(
    "{}/{}/{}".format,
    st.sampled_from(["std_msgs", "a", "my_msgs_2"]),
    st.sampled_from(["msg", "srv", "action"]),
    st.sampled_from(["String", "A", "Two_Ints_SendGoal", "B2"]),
)
hashes = st.none() | st.binary(min_size=32, max_size=32).map(lambda digest: f"RIHS01_{digest.hex()}")
domains = st.integers(0, 232)
suffixes = st.just("") | st.just("_buf_cpu") | hexes.map("_buf/{}".format)
data_keys = st.builds(DataKey, domains, names, type_names, hashes, suffixes)
durations = st.tuples(st.integers(0, 9_999_999_999), st.integers(0, 999_999_999))
qos = st.builds(
    RosQos,
    st.integers(0, 4),
    st.integers(0, 4),
    st.integers(0, 3),
    st.integers(0, 9_999_999_999),
    durations,
    durations,
    st.integers(0, 5),
    durations,
)
nodes = st.builds(Node, domains, hexes, st.integers(0, 999), names, names | st.just("/"), st.just("") | words)
endpoints = st.builds(
    NodeEndpoint,
    nodes,
    st.integers(0, 999),
    st.sampled_from(["MP", "MS", "SS", "SC"]),
    names,
    type_names,
    hashes,
    qos,
    st.just("") | words,
)
numbers = st.none() | st.integers(0, 3)
bridge_qos = st.builds(
    lambda keyed, reliability, durability, history, data: BridgeQos(keyed, reliability, durability, *history, data),
    st.booleans(),
    numbers,
    numbers,
    st.just((None, None)) | st.tuples(st.integers(0, 1), st.integers(0, 9_999_999_999)),
    st.just("") | hexes.map("typehash=RIHS01_{};".format),
)
bridge_tokens = st.builds(
    lambda zid, kind, name, type_name, said: BridgeToken(
        zid, kind, name[1:], type_name, said if kind in ("MP", "MS") else None
    ),
    hexes,
    st.sampled_from(["MP", "MS", "SS", "SC", "AS", "AC"]),
    names,
    type_names,
    bridge_qos,
)
