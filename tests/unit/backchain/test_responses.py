from __future__ import annotations

import numpy as np
import pytest

from riot_bus.backchain.responses import CHANNELS, residuals, responses

SAMPLES = 120


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def centred(values):
    return values - values.mean(axis=0)


def test_each_run_is_centred_alone(rng):
    pieces = [rng.normal(size=50), 7 + rng.normal(size=30)]
    found = responses(pieces)
    assert found.shape == (80, 3)
    assert np.abs(found[:50].mean(axis=0)).max() < 1e-12
    assert np.abs(found[50:].mean(axis=0)).max() < 1e-12


def test_what_a_selected_field_explains_is_taken_away(rng):
    design = centred(rng.normal(size=(SAMPLES, 4)))
    pieces = [design[:, 2] + 0.1 * rng.normal(size=SAMPLES)]
    raw, left = residuals(pieces, {"a": design}, selected=["a"])
    assert left.shape == (SAMPLES, len(CHANNELS))
    assert left[:, 0].std() < 0.2 * raw[:, 0].std()
    assert left[:, 4].std() < 0.2 * raw[:, 0].std()


def test_a_selected_field_that_explains_nothing_takes_nothing_away(rng):
    raw, left = residuals([rng.normal(size=SAMPLES)], {"a": np.zeros((SAMPLES, 4))}, selected=["a"])
    np.testing.assert_allclose(left[:, 0], raw[:, 0])
    np.testing.assert_allclose(left[:, 4], raw[:, 0], atol=1e-12)


def test_jumps_are_cut_short_so_that_a_weak_effect_beside_them_shows(rng):
    strong, weak = centred(np.repeat(rng.normal(size=SAMPLES // 10), 10)), centred(rng.normal(size=SAMPLES))
    response = 10 * strong + 0.2 * weak
    response[::10] += 10 * rng.normal(size=SAMPLES // 10)  # jitter around the jumps
    _, left = residuals([response], {"strong": strong[:, None]}, selected=["strong"])
    plain, robust = (abs(np.corrcoef(left[:, at], weak)[0, 1]) for at in (0, 4))
    assert robust > plain + 0.1


def test_trimming_stops_while_enough_samples_are_left(rng):
    rest = np.tile((1e-3, -1e-3), 8)
    rest[:6] = (0.5, -0.5) * 3
    basis, _ = np.linalg.qr(np.column_stack([np.ones(16), rest, rng.normal(size=(16, 4))]))
    design = basis[:, 2:]
    _, left = residuals([design @ (3000.0, 300.0, 60.0, 20.0) + rest], {"a": design}, selected=["a"])
    np.testing.assert_allclose(left[:, 0], rest, atol=1e-9)
    assert np.abs(left[:, 4]).max() < 0.01  # the six are cut short; a fit to the other ten needs half as many terms
