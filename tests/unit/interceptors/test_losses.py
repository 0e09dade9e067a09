import pytest

from riot_bus.interceptors.losses import Bandwidth, Drop, Throttle
from riot_bus.interceptors.timing import Delay
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message


def runs(flags):
    """Lengths of the runs of True."""
    return [len(part) for part in "".join("x" if flag else " " for flag in flags).split()]


def dropped(run, number=20, **more):
    return [run.feed(0.1 * n, {"n": n}, **more).dropped for n in range(number)]


def test_drop_all(bench):
    assert all(dropped(bench(Drop())))


def test_drop_every_third_of_each_topic(bench):
    run = bench(Drop(every=3))
    for key in "ab":
        assert dropped(run, 7, key=key) == [False, False, True, False, False, True, False]


def test_drop_in_bursts(bench):
    assert dropped(bench(Drop(every=5, burst=2)), 12) == [*[False] * 4, True, True, *[False] * 3, True, True, False]


def test_drop_by_chance_in_bursts(bench):
    run = bench(Drop(chance=0.05, burst=4))
    lost = dropped(run, 1000)
    assert min(runs(lost)) == 4
    assert 0.1 < sum(lost) / 1000 < 0.3
    assert lost == dropped(bench(Drop(chance=0.05, burst=4)), 1000)
    assert lost != dropped(bench(Selective(Drop(chance=0.05, burst=4), When(seed=1))), 1000)


@pytest.mark.parametrize("wrong", [{"every": 0}, {"burst": 0}, {"chance": 1.5}, {"chance": float("nan")}])
def test_drop_refuses(wrong):
    with pytest.raises(ConfigError):
        Drop(**wrong)


def test_throttle_lets_its_own_rate_pass_exactly(bench):
    run = bench(Throttle(10))
    assert not any(run.feed(n / 10).dropped for n in range(100))


@pytest.mark.parametrize(("sent", "rate"), [(100, 10), (15, 10), (30, 20), (7, 3)])
def test_throttle_keeps_to_its_rate(bench, sent, rate):
    run = bench(Throttle(rate))
    run.feed_all([n / sent for n in range(sent * 10)])
    assert abs(len(run.delivered) - rate * 10) <= 1
    run.feed_all([n / sent for n in range(sent)], key="b")
    assert abs(sum(each.message.key == "b" for each in run.delivered) - rate) <= 1


def test_throttle_goes_on_when_the_clock_is_set_back(bench):
    run = bench(Throttle(10))
    assert [each.dropped for each in run.feed_all([3600.0, 0.0, 0.05, 0.1])] == [False, False, True, False]


@pytest.mark.parametrize("rate", [0, -1, float("nan"), float("inf")])
def test_rates_are_above_zero(rate):
    with pytest.raises(ConfigError, match="not above 0"):
        Throttle(rate)
    with pytest.raises(ConfigError, match="not above 0"):
        Bandwidth(rate)


def test_bandwidth_sends_one_after_the_other(bench):
    run = bench(Bandwidth(100))
    run.feed_all([0.0, 0.0, 0.0, 9.0], payload=bytes(50))
    assert run.times() == [0.5, 1.0, 1.5, 9.5]


def test_bandwidth_drops_what_does_not_fit_in_the_queue(bench):
    run = bench(Bandwidth(100, queue=100))
    assert [each.dropped for each in run.feed_all([0.0] * 3, payload=bytes(50))] == [False, False, True]
    assert not run.feed(1.5, bytes(500)).dropped  # an idle link takes any message
    assert run.feed(1.6, bytes(1)).dropped


def test_links_are_shared_or_not(bench):
    for shared, due in ((True, [0.5, 1.0]), (False, [0.5, 0.5])):
        run = bench(Bandwidth(100, shared=shared))
        for key in "ab":
            run.feed(0.0, bytes(50), key=key)
        assert run.times() == due


def test_bandwidth_goes_on_when_the_clock_is_set_back(bench):
    run = bench(Bandwidth(100, queue=100))
    run.feed_all([3600.0, 0.0, 2.0], payload=bytes(50))
    assert run.times() == [3600.5, 1.0, 2.5]


def test_throttle_counts_a_message_on_several_ways_once():
    pipeline = Pipeline([Selective(Delay(0.0), When(target="b")), Throttle(10)], registry=TypeRegistry())
    for n in range(10):  # two at a time, of which one is too many
        result = pipeline.feed(Message(n // 2 * 10**8, "a", b""), targets=("b", "c"))
        assert sorted(each.targets for each in result.emissions) == ([("b",), ("c",)] if n % 2 == 0 else [])
