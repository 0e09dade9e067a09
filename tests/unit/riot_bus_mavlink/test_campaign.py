"""What a campaign draws for messages of MAVLink."""

import random

from riot_bus.campaign.groups import groups_of
from riot_bus.campaign.schedule import Schedule
from riot_bus.campaign.targets import targets_of
from riot_bus.inject.apply import inject_log
from riot_bus.inject.dictionary import load_dictionary
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus_mavlink.adapter import MavlinkAdapter
from riot_bus_mavlink.frame import Framer, pack_frame

ADAPTER = MavlinkAdapter("common")
NAMES = ("COMMAND_LONG", "HEARTBEAT", "MISSION_ITEM_INT", "PARAM_VALUE", "STATUSTEXT")
COMMAND = "mavlink_raw/gcs/1/1/COMMAND_LONG"


def log(count=10):
    messages = []
    for number in range(count):
        for name in NAMES:
            message = ADAPTER.dialect.message(name)
            raw = pack_frame(
                message.id, bytes(message.size), message.crc_extra, version=2, sequence=number, system=1, component=1
            )
            fields = {"command": 400, "param1": 1.0} if name == "COMMAND_LONG" else {}
            raw = ADAPTER.type_named(f"mavlink/{name}").patch(raw, fields)
            messages.append(Message(10**9 + number, f"mavlink_raw/gcs/1/1/{name}", raw))
    return messages


def test_targets_have_what_definitions_tell():
    targets = targets_of(log(), TypeRegistry([ADAPTER]))
    fields = {target.path: target for target in targets[COMMAND]}
    assert set(fields) == {"command", "confirmation", *(f"param{n}" for n in range(1, 8))}
    assert {21196.0, 0.0} <= {entry.value for entry in fields["param2"].told}
    assert {"seq", "x", "frame"} <= {target.path for target in targets["mavlink_raw/gcs/1/1/MISSION_ITEM_INT"]}
    asked = targets_of(log(), TypeRegistry([ADAPTER]), include=["*:target_system", "*:header.*"])
    assert {"target_system", "header.sequence"} <= {target.path for target in asked[COMMAND]}


def test_what_is_drawn_makes_sound_frames():
    messages, registry, dictionary = log(), TypeRegistry([ADAPTER]), load_dictionary()
    targets = targets_of(messages, registry)
    groups = groups_of(messages, registry, dictionary)
    assert set(groups) == {f"mavlink_raw/gcs/1/1/{name}" for name in NAMES}
    schedule = Schedule(targets, dictionary, seed=1, groups=groups)
    changed, values = 0, set()
    for trial in range(100):
        injections = schedule.injections(trial)
        values |= {(each.topic, each.field, repr(each.value)) for each in injections}
        delivered, originals = inject_log(messages, injections, registry=registry)
        changed += len(originals)
        framer = Framer(ADAPTER.dialect.crc_extra)
        stream = b"".join(message.payload for message in delivered)
        assert [frame.raw for frame in framer.feed(stream)] == [message.payload for message in delivered]
    assert changed > 300
    told = {(one.topic, one.path, repr(entry.value)) for some in targets.values() for one in some for entry in one.told}
    assert len(values & told) > 30
    assert len(values) > 100


def test_draws_do_not_depend_on_the_order_of_messages():
    messages, registry, dictionary = log(), TypeRegistry([ADAPTER]), load_dictionary()
    other = sorted(messages, key=lambda each: (each.time, random.Random(each.key).random()))
    one, two = (Schedule(targets_of(each, registry), dictionary, seed=5) for each in (messages, other))
    assert [repr(one.injections(n)) for n in range(30)] == [repr(two.injections(n)) for n in range(30)]
