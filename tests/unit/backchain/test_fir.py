from __future__ import annotations

import numpy as np

from riot_bus.backchain.fir import fit_terms, standardise


def test_columns_that_explain_are_chosen_in_the_order_of_what_they_explain():
    rng = np.random.default_rng(0)
    design = rng.normal(size=(200, 6))
    response = 3 * design[:, 4] + design[:, 1] + 0.1 * rng.normal(size=200)
    assert fit_terms(response, design, most=6) == [4, 1]
    assert fit_terms(response, design, most=1) == [4]


def test_constant_columns_and_noise_explain_nothing():
    rng = np.random.default_rng(1)
    response = rng.normal(size=100)
    assert fit_terms(response, np.zeros((100, 3)), most=3) == []
    assert fit_terms(response, rng.normal(size=(100, 3)), most=3) == []
    assert fit_terms(np.zeros(100), rng.normal(size=(100, 3)), most=3) == []


def test_a_column_is_chosen_if_it_saves_more_than_it_costs_to_name_it():
    """BIC of one parameter, log(samples), and of a choice among columns, twice the log of their number."""
    samples, columns, rest = 100, 50, 50.0
    price = np.log(samples) + 2 * np.log(columns)
    for share, chosen in ((1.02, [0]), (0.98, [])):
        response = np.array([np.sqrt(rest * np.expm1(share * price / samples)), *[0.0] * 49, *[1.0] * 50])
        assert fit_terms(response, np.eye(samples, columns), most=3) == chosen


def test_an_outlier_is_clipped_before_the_scale_is_measured():
    values = np.sin(np.arange(100.0))
    values[50] = 20.0
    plain = (values - values.mean()) / values.std()
    shown = standardise(values)
    assert np.ptp(np.delete(shown, 50)) > 1.5 * np.ptp(np.delete(plain, 50))
    assert not standardise(np.array([np.nan, np.inf, 1.0, 2.0])).any()
