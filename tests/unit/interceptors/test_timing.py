import pytest

from riot_bus.interceptors.losses import Bandwidth
from riot_bus.interceptors.timing import Delay, Jitter, Reorder
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.vocabulary.errors import ConfigError


def test_delay(bench):
    run = bench(Delay(0.5))
    run.feed_all([0.0, 0.1])
    assert run.times() == [0.5, 0.6]


def test_jitter_spreads_and_keeps_the_order(bench):
    run = bench(Jitter(0.1, 0.1))
    times = [0.01 * n for n in range(100)]
    run.feed_all(times)
    due = run.times()
    assert due == sorted(due)
    late = [came - sent for came, sent in zip(due, times, strict=True)]
    assert all(0 <= each <= 0.2 + 1e-8 for each in late)
    assert len({round(each, 4) for each in late}) > 10


@pytest.mark.parametrize("after", [Jitter(0.05, 0.05), Bandwidth(200)])
@pytest.mark.parametrize("before", [Jitter(0.05, 0.05), Bandwidth(200)])
def test_order_is_kept_by_several_in_a_row(bench, before, after):
    run = bench(before, after)
    run.feed_all([0.01 * n for n in range(100)])
    assert run.times() == sorted(run.times())


def test_jitter_depends_on_the_seed_alone(bench):
    def due(seed):
        run = bench(Selective(Jitter(0.1, 0.1), When(seed=seed)))
        run.feed_all([0.0, 1.0, 2.0])
        return run.times()

    assert due(1) == due(1) != due(2)


def test_a_clock_that_is_set_back_does_not_hold_up_messages(bench):
    run = bench(Jitter(0.1, 0.1))
    run.feed_all([3600.0, 0.0, 0.1, 0.2])
    assert all(due <= sent + 0.2 + 1e-8 for due, sent in zip(run.times()[1:], [0.0, 0.1, 0.2], strict=True))


def test_reorder_changes_the_order_within_its_window(bench):
    run = bench(Reorder(0.1))
    times = [0.01 * n for n in range(100)]
    run.feed_all(times)
    assert run.times() != sorted(run.times())
    assert all(0 <= due - sent <= 0.1 for due, sent in zip(run.times(), times, strict=True))


@pytest.mark.parametrize("make", [lambda: Delay(-1), lambda: Jitter(0, float("nan")), lambda: Reorder(float("inf"))])
def test_times_are_finite_and_not_negative(make):
    with pytest.raises(ConfigError, match="is not a time"):
        make()
