from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from riot_bus_bridges.ros2.options import Names, Ros2BridgeOptions
from riot_bus_bridges.ros2.plan import DomainAnnouncement, DomainEndpoint, DomainGraph, plan_of
from riot_bus_ros2.keys import DataKey
from riot_bus_ros2.qos import FOREVER, RosQos
from riot_bus_ros2.tokens import Node, NodeEndpoint

STRING, HASH = "std_msgs/msg/String", "RIHS01_aa"
SWITCH = "std_srvs/srv/SetBool"
RELIABLE, BEST_EFFORT = RosQos(depth=0), RosQos(reliability=2, depth=0)
LATCHED = RosQos(durability=1, depth=0)
KEY = DataKey(0, "/chatter", STRING, HASH)
OPTIONS = Ros2BridgeOptions(depth=1000, latched=100)
SECOND = (1, 0)

numbers = st.tuples(
    st.sampled_from([1, 2]),
    st.sampled_from([1, 2]),
    st.sampled_from([1, 2, 3]),
    st.integers(0, 5000),
    *[st.integers(0, 10**12)] * 2,
    st.sampled_from([1, 3]),
    st.integers(0, 10**12),
)
profiles = numbers.map(RosQos.of_numbers)


def found(profile=RELIABLE, *, node="/talker", topic="/chatter", kind=STRING, hashed=HASH, gid="01"):
    return DomainEndpoint(node, topic, kind, hashed, profile, gid)


USUAL = RosQos()


def token(kind="MP", qos=USUAL, *, topic="/chatter", type_name=STRING, hashed=HASH, domain=0):
    return NodeEndpoint(Node(domain, "ab", 0, "/far"), 1, kind, topic, type_name, hashed, qos)


def plan(*, segment=(), options=OPTIONS, **graph):
    return plan_of(DomainGraph(**graph), segment, Names(options), options)


def compatible(offered, requested):
    """DDS's rule of requested and offered quality."""
    return (
        (offered.reliability == 1 or requested.reliability == 2)
        and (offered.durability == 1 or requested.durability == 2)
        and offered.deadline <= requested.deadline
        and offered.liveliness >= requested.liveliness
        and offered.lease <= requested.lease
    )


def test_nothing_is_done_for_nothing():
    assert plan() == plan_of(DomainGraph(), [], Names(OPTIONS), OPTIONS)
    assert not any((plan().ups, plan().downs, plan().offered, plan().wanted, plan().announcements, plan().foreign))


def test_what_the_domain_publishes_goes_up_and_is_announced():
    wanted = plan(publishers=[found(), found(BEST_EFFORT, node="/other", gid="02")])
    assert wanted.downs == {}
    up = wanted.ups[KEY]
    assert (up.reader.reliability, up.reader.durability, up.reliable, up.latched) == (2, 2, False, False)
    qos = RosQos(depth=10)
    assert wanted.announcements == {
        DomainAnnouncement(None, "/talker"),
        DomainAnnouncement(None, "/other"),
        DomainAnnouncement("MP", "/talker", KEY, qos, "01"),
        DomainAnnouncement("MP", "/other", KEY, RosQos(reliability=2, depth=10), "02"),
    }


def test_latched_topics_are_latched_on_the_segment_if_all_publishers_are():
    up = plan(publishers=[found(LATCHED)]).ups[KEY]
    assert up.latched
    assert up.reader.durability == 1
    announcement = next(each for each in plan(publishers=[found(LATCHED)]).announcements if each.kind)
    assert (announcement.qos.durability, announcement.qos.depth) == (1, 100)
    assert not plan(publishers=[found(LATCHED), found(gid="02")]).ups[KEY].latched


def test_what_the_segment_publishes_comes_down_as_it_is_offered():
    qos = RosQos(reliability=2, durability=1, depth=3, deadline=(2, 5), lifespan=(9, 0))
    other = RosQos(reliability=2, durability=1, depth=4, deadline=(1, 0))
    down = plan(segment=[token(qos=qos), token(qos=other)], subscriptions=[found(node="/l")]).downs[KEY]
    assert down.writer == RosQos(2, 1, 1, 7, SECOND, FOREVER)
    assert down.latched == 7
    assert plan(segment=[token()]).downs[KEY].latched is None


def test_a_bridge_keeps_messages_once_for_all_that_it_announces():
    qos = RosQos(durability=1, depth=100)
    one = token(qos=qos)
    tokens = [one, replace(one, number=2), replace(one, node=replace(one.node, zid="cd"))]

    def latched(*bridges):
        return plan_of(DomainGraph(), tokens, Names(OPTIONS), OPTIONS, bridges=bridges).downs[KEY].latched

    assert (latched(), latched("ab"), latched("ab", "cd")) == (300, 200, 200)
    assert plan_of(DomainGraph(), tokens[:1], Names(OPTIONS), OPTIONS, bridges=["ab"]).downs[KEY].latched == 100


def test_plans_are_the_same_whoever_publishes():
    wanted, sourced = plan(subscriptions=[found()]).downs[KEY], plan(segment=[token()]).downs[KEY]
    assert (wanted.sourced, sourced.sourced) == (False, True)
    assert wanted.means(sourced)
    assert not wanted.means(plan(segment=[token(qos=RosQos(reliability=2))]).downs[KEY])
    assert not wanted.means(plan(publishers=[found()]).ups[KEY])


def test_what_only_the_domain_wants_is_offered_so_that_all_get_it():
    down = plan(subscriptions=[found(), found(RosQos(2, 1, depth=0, deadline=SECOND), gid="02")]).downs[KEY]
    assert down.writer == RosQos(1, 1, 1, 100, SECOND)
    assert down.latched == 100


def test_hidden_and_foreign_domains_stay_where_they_are():
    wanted = plan(publishers=[found(topic="/rosout"), found(topic="/_x")], subscriptions=[found(topic="/rosout")])
    assert not wanted.ups
    assert not wanted.downs
    assert not wanted.announcements


def test_services_are_answered_from_the_other_side():
    key = DataKey(0, "/switch", SWITCH, HASH)
    server = found(topic="/switch", kind=SWITCH)
    assert plan(servers=[server]).offered == {key}
    here = plan(servers=[server], segment=[token("SS", topic="/switch", type_name=SWITCH)])
    assert (here.offered, here.wanted) == ({key}, set())
    there = plan(clients=[server], segment=[token("SS", topic="/switch", type_name=SWITCH)])
    assert (there.offered, there.wanted) == (set(), {key})
    assert {each.kind for each in there.announcements} == {None, "SC"}
    assert plan(segment=[token("SC", topic="/switch", type_name=SWITCH)]).wanted == set()


def test_types_that_do_not_meet_are_named():
    assert plan(segment=[token(hashed="RIHS01_bb")], subscriptions=[found()]).foreign == {"/chatter"}
    assert plan(segment=[token(type_name="std_msgs/msg/Int8")], publishers=[found()]).foreign == {"/chatter"}
    assert plan(segment=[token(hashed="RIHS01_bb"), token()], subscriptions=[found()]).foreign == set()


def test_keys_have_the_domain_of_the_segment():
    options = Ros2BridgeOptions(domain=7, zenoh_domain=3)
    assert set(plan(options=options, publishers=[found()]).ups) == {DataKey(3, "/chatter", STRING, HASH)}


def test_publishers_that_are_no_nodes_have_a_name():
    announcements = plan(publishers=[found(node="")]).announcements
    assert {each.node for each in announcements} == {"/dds"}


@given(st.lists(profiles, min_size=1, max_size=5))
def test_a_reader_gets_what_all_publishers_offer(offered):
    up = plan(publishers=[found(each, gid=str(number)) for number, each in enumerate(offered)]).ups[KEY]
    assert all(compatible(each, up.reader) for each in offered)


@given(st.lists(profiles, min_size=1, max_size=5))
def test_a_writer_without_example_serves_all_subscriptions(requested):
    wanted = plan(subscriptions=[found(each, gid=str(number)) for number, each in enumerate(requested)])
    assert all(compatible(wanted.downs[KEY].writer, each) for each in requested)


@given(profiles, profiles)
def test_who_gets_a_message_in_its_own_domain_gets_it_in_the_other(offered, requested):
    qos = replace(offered, depth=10)
    down = plan(segment=[token(qos=qos)], subscriptions=[found(requested)]).downs[KEY]
    assert compatible(down.writer, requested) == compatible(offered, requested)


@given(numbers)
def test_profiles_survive_their_announcement(numbers):
    qos = RosQos.of_numbers(numbers)
    assert RosQos.parse(qos.token()) == qos
    assert RosQos.of_numbers(qos.numbers()) == qos
    assert (qos.numbers()[:2], qos.numbers()[3:]) == (list(numbers[:2]), list(numbers[3:]))


def test_a_duration_of_zero_is_endless():
    qos = RosQos(deadline=(0, 0), lifespan=(0, 0), lease=(0, 0))
    assert plan(segment=[token(qos=qos), token(qos=RosQos(lifespan=(9, 0)))]).downs[KEY].writer == RosQos(depth=1000)
