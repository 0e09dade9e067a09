from __future__ import annotations

import numpy as np
import pytest

from riot_bus_fleet.evidence.alignment import Piece, held_variants, response_of, topic_of


def piece(*, out=60, step=1.0, log=0, **others):
    times = {"out": np.arange(out) * step + 0.25}
    values = {"out:v": np.sin(np.arange(out))}
    for name, (when, what) in others.items():
        times[name], values[f"{name}:v"] = np.asarray(when, dtype=float), np.asarray(what, dtype=float)
    return Piece(times, values, log)


def test_topic_of_a_key_with_a_type_in_it():
    assert topic_of("0/odom/nav_msgs::msg::dds_::Odometry_:twist.x") == "0/odom/nav_msgs::msg::dds_::Odometry_"


def test_a_candidate_is_what_it_held_and_how_old_that_was():
    when, what = np.arange(60) * 1.0, np.arange(60) % 7
    one = piece(e=(when, what))
    response = response_of([one], "out:v")
    found = held_variants([one], "e:v", response)
    level = what - what.mean()
    assert np.corrcoef(found.parts[0][0], level)[0, 1] == pytest.approx(1)
    assert found.age == pytest.approx(0.25)
    assert (found.rows, found.logs, found.changes) == (60, 1, 59)


def test_of_a_fast_candidate_the_mean_since_the_row_before_counts_too():
    when, what = np.arange(600) * 0.1, np.where(np.arange(600) % 10 == 5, 10.0 * np.arange(600), 0.0)
    one = piece(e=(when, what))
    found = held_variants([one], "e:v", response_of([one], "out:v"))
    assert found.parts[0].shape == (5, 60)
    assert not found.parts[0][0].any()
    assert np.corrcoef(found.parts[0][4][2:], np.arange(58))[0, 1] > 0.99


@pytest.mark.parametrize(
    ("when", "what", "reason"),
    [
        (np.arange(60.0), np.ones(60), "it never changes within a log"),
        (np.arange(60.0), np.arange(60) > 30, "it changes 1 times in all logs, too few to tell (at least 5)"),
        (np.arange(60.0), np.full(60, np.nan), "no log has it beside the field that is asked for"),
    ],
)
def test_a_candidate_that_cannot_be_told_of_says_why(when, what, reason):
    one = piece(e=(when, what))
    assert held_variants([one], "e:v", response_of([one], "out:v")) == reason


def test_a_response_that_cannot_be_told_of_says_why():
    assert response_of([piece()], "none:v") == "no log has it"
    assert response_of([piece(out=3)], "out:v") == "it has 3 values"
    assert response_of([piece(out=20)], "out:v") == "20 values are too few to tell (at least 40)"
    assert response_of([piece(e=(np.arange(9.0), np.ones(9)))], "e:v") == "it never changes within a log"


def test_many_rows_are_cut_to_the_middle_of_each_log():
    found = response_of([piece(out=9000, log=0), piece(out=9000, log=1)], "out:v")
    assert found.rows == 10_000
    assert found.times[0][0] == pytest.approx(2000.25)


def test_logs_without_the_candidate_do_not_count_for_it():
    with_it = piece(e=(np.arange(60.0), np.arange(60) % 5), log=0)
    both = [with_it, piece(log=1)]
    found = held_variants(both, "e:v", response_of(both, "out:v"))
    assert (found.rows, found.logs) == (60, 1)
