from __future__ import annotations

import json

import pytest

from riot_bus.campaign.groups import groups_of
from riot_bus.campaign.schedule import Schedule
from riot_bus.campaign.targets import targets_of
from riot_bus.inject.apply import inject_log
from riot_bus.inject.dictionary import Dictionary, load_dictionary
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Formula, Injection
from riot_bus.vocabulary.message import Message
from riot_bus_ros2.adapter import Ros2Adapter

ADAPTER = Ros2Adapter()
SHIPPED = load_dictionary()
TOPICS = {
    "/odom": ("nav_msgs/msg/Odometry", {"pose.pose.orientation.w": 1.0, "header.stamp.sec": 1_700_000_000}),
    "/plan": ("nav_msgs/msg/Path", {"len(poses)": 2}),
    "/map": (
        "nav_msgs/msg/OccupancyGrid",
        {"info.width": 4, "info.height": 3, "info.resolution": 0.5, "len(data)": 12},
    ),
    "/image": ("sensor_msgs/msg/Image", {"width": 4, "height": 3, "step": 12, "len(data)": 36, "encoding": "rgb8"}),
}


def log(*topics: str, count: int = 12) -> tuple[list[Message], TypeRegistry]:
    registry = TypeRegistry([ADAPTER], declared={topic: TOPICS[topic][0] for topic in topics})
    messages = []
    for number in range(count):
        for topic in topics:
            name, values = TOPICS[topic]
            kind = ADAPTER.type_named(name)
            assert kind is not None
            zeros = b"\0\1\0\0" + bytes(1024)
            texts = {leaf.path: "s" for leaf in kind.leaves(zeros, elements=100) if leaf.type == "string"}
            messages.append(Message(10**9 + number, topic, kind.rebuild(zeros, texts | values)))
    return messages, registry


def families(topic: str, **more) -> set[str]:
    messages, registry = log(topic)
    found = groups_of(messages, registry, SHIPPED, **more).get(topic, {})
    return {name.partition(": ")[0].rpartition("/")[2] + " at " + name.rpartition(" at ")[2] for name in found}


def test_mutations_are_found_wherever_their_type_is_nested() -> None:
    assert families("/odom") == {
        "geometry_msgs.toml at pose",
        "geometry_msgs.toml at twist",
        "geometry_msgs.toml at pose.pose.orientation",
    }
    assert families("/plan") == {"nav_msgs.toml at ", "geometry_msgs.toml at poses[*].pose.orientation"}
    assert "nav_msgs.toml at info" in families("/map")
    messages, registry = log("/plan")
    groups = groups_of(messages, registry, SHIPPED)["/plan"]
    assert {one.base for some in groups.values() for one in some} == {
        "", "poses[0].pose.orientation", "poses[1].pose.orientation"
    }  # fmt: skip


def test_stamps_are_only_changed_on_request() -> None:
    stamps = "builtin_interfaces.toml at header.stamp"
    assert stamps not in families("/odom")
    assert stamps in families("/odom", include=["/odom:header.stamp.*"])
    assert stamps not in families("/odom", include=["/odom:header.stamp.sec"], leave=["/odom:*.nanosec", "*:*.sec"])
    assert "builtin_interfaces.toml at info.map_load_time" not in families("/map")
    assert "builtin_interfaces.toml at info.map_load_time" in families("/map", include=["/map:info.map_load_time.*"])


def test_fields_that_are_left_alone_and_their_lengths() -> None:
    messages, registry = log("/image")
    every = groups_of(messages, registry, SHIPPED)["/image"]
    fewer = groups_of(messages, registry, SHIPPED, leave=["/image:data"])["/image"]

    def paths(groups) -> set[str]:
        return {path for some in groups.values() for one in some for path, _ in one.mutation.at(one.base)}

    assert paths(every) - paths(fewer) == {"len(data)"}
    assert groups_of(messages, registry, SHIPPED, leave=["*"]) == {}


def test_a_group_changes_all_its_fields_in_one_stretch() -> None:
    messages, registry = log("/map", count=8)
    groups = groups_of(messages, registry, SHIPPED)
    for one in (one for some in groups["/map"].values() for one in some):
        injections = one.injections(2, 5, seed=3)
        assert {(each.topic, each.first, each.last, each.seed) for each in injections} == {("/map", 2, 5, 3)}
        _, touched = inject_log(messages, injections, registry=registry)
        assert [index for index, *_ in touched] == [2, 3, 4, 5]
        assert all(len(changes) == len(injections) for *_, changes in touched)


def test_schedules_draw_groups_and_single_fields() -> None:
    messages, registry = log("/odom", "/image")
    targets = targets_of(messages, registry)

    def drawn(seed: int = 0) -> list[tuple[Injection, ...]]:
        schedule = Schedule(targets, SHIPPED, seed=seed, groups=groups_of(messages, registry, SHIPPED))
        return [schedule.injections(trial) for trial in range(150)]

    once = drawn()
    assert repr(once) == repr(drawn())
    assert repr(once) != repr(drawn(1))
    paths = [each.field for trial in once for each in trial]
    assert any(path.startswith("len(") for path in paths if path)
    assert "twist.twist.linear.x" in paths
    assert any(isinstance(each.value, Formula) for trial in once for each in trial)
    for trial in once:
        for each in trial:
            assert each.last is not None
            assert 0 <= each.first <= each.last < 12
        inject_log(messages, trial, registry=registry)  # none of them fails
    only = Schedule({}, SHIPPED, seed=0, groups=groups_of(messages, registry, SHIPPED))
    assert all(only.injections(trial) for trial in range(20))


def test_arrays_that_grow_a_lot_are_mutated_in_few_messages() -> None:
    messages, registry = log("/plan", count=500)
    groups = groups_of(messages, registry, SHIPPED)["/plan"]
    (long,) = [one for some in groups.values() for one in some if dict(one.mutation.changes).get("len(poses)") == 10000]
    assert long.most * 10_000 * 64 <= 1 << 26
    assert {one.most for some in groups.values() for one in some if one is not long} == {500}
    schedule = Schedule({}, Dictionary(), seed=0, groups={"/plan": {"long": [long]}})
    assert all(each.last - each.first < long.most for n in range(50) for each in schedule.injections(n))


def own(text: str) -> Dictionary:
    dictionary = Dictionary()
    dictionary.add(text, where="mine.toml", own=True)
    return dictionary


def test_own_mutations_that_name_no_field_are_an_error() -> None:
    messages, registry = log("/odom")
    mutation = '{ set = { "twist.twist.linaer.x" = nan }, reason = "r" }'
    mine = f'[[message]]\ntype = "nav_msgs/msg/Odometry"\nmutations = [{mutation}]'
    with pytest.raises(ConfigError, match="no field 'twist") as caught:
        groups_of(messages, registry, own(mine))
    assert caught.value.where == "mine.toml: message[0]"
    assert "twist.twist.linear.x" in str(caught.value.hint)


def test_types_that_describe_themselves() -> None:
    payload = json.dumps({"w": 2, "h": 3, "data": [1, 2, 3, 4, 5, 6]}).encode()
    mine = own('[[message]]\ntype = "json"\nmutations = [{ set = { h = "h + 1" }, reason = "r" }]')
    messages = [Message(n, "image", payload) for n in range(3)]
    groups = groups_of(messages, TypeRegistry(), mine)
    ((one,),) = groups["image"].values()
    assert one.injections(0, 2, seed=0) == [Injection("image", "h", Formula("h + 1"), last=2)]
    other = [Message(n, "image", b'{"x": 1}') for n in range(3)]
    assert groups_of(other, TypeRegistry(), mine) == {}


def test_messages_that_are_cut_off_have_no_mutations() -> None:
    messages, registry = log("/plan")
    cut = [message.with_(payload=message.payload[:6]) for message in messages]
    assert groups_of(cut, registry, SHIPPED) == {}


def test_own_mutations_that_name_fields_are_made() -> None:
    messages, registry = log("/odom")
    mutation = '{ set = { "twist.twist.linear.x" = nan }, reason = "r" }'
    mine = f'[[message]]\ntype = "nav_msgs/msg/Odometry"\nmutations = [{mutation}]'
    ((one,),) = groups_of(messages, registry, own(mine))["/odom"].values()
    assert [each.field for each in one.injections(0, 3, seed=0)] == ["twist.twist.linear.x"]
