from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from riot_bus.backchain.activation import Evaluation, activate
from riot_bus.backchain.box import Box, RegionSample, fit_box
from riot_bus.backchain.encoding import Encoding, SearchField
from riot_bus.backchain.fir import standardise
from riot_bus.backchain.graph import ComponentTopics, TopicGraph
from riot_bus.backchain.permeability import FieldDrive, Run, analyse
from riot_bus.vocabulary.injection import Signal
from riot_bus.vocabulary.trial import Series

numbers = st.floats(-1e6, 1e6)
topics = st.sampled_from("abcdef")
graphs = st.dictionaries(
    st.sampled_from("PQRST"),
    st.builds(ComponentTopics, st.frozensets(topics, max_size=3), st.frozensets(topics, max_size=3)),
).map(TopicGraph)


@st.composite
def search_fields(draw):
    low, high = sorted((draw(numbers), draw(numbers)))
    assume(high - low > 1e-3)
    return SearchField("f", draw(st.floats(low, high)), draw(st.floats(1e-3, 1e3)), low, high)


@given(search_fields(), st.floats(0, 1))
def test_decoded_values_stay_in_range_and_close(field, share):
    encoding = Encoding((field,))
    value = encoding.decode([share])["f"]
    assert field.low <= value <= field.high
    assert abs(field.encode(value) - field.encode(field.sensible(value))) <= 2e-3


@given(st.lists(st.floats(), min_size=1, max_size=40))
def test_standardised_series_are_finite_and_centred(values):
    result = standardise(np.asarray(values))
    assert np.isfinite(result).all()
    assert abs(result.mean()) < 1e-9


@given(graphs, topics, st.sets(topics))
def test_backtrack_tree_holds_exactly_the_externals_that_reach(graph, topic, externals):
    tree = graph.backtrack_tree(topic, externals, most=100_000)
    found, ahead = set(), [tree]
    while ahead:
        hop = ahead.pop()
        ahead += hop.hops
        if hop.external:
            found.add(hop.topic)
    assert found <= graph.reaching(topic) & externals
    # An external behind another external is the only one that may be missing.
    for missing in (graph.reaching(topic) & externals) - found:
        assert graph.reached(missing) & found


@given(st.lists(st.tuples(numbers, numbers, st.booleans()), max_size=20))
def test_fitted_boxes_are_ordered(samples):
    some = [RegionSample((x, y), failed) for x, y, failed in samples]
    box = fit_box([*some, RegionSample((0.0, 0.0), failed=True)], Box((-1.0, 1.0, -1.0, 1.0)))
    assert all(low <= high for low, high in box.ranges)


@settings(max_examples=8, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 5),
    st.lists(st.one_of(st.none(), st.floats(allow_nan=True)), min_size=1, max_size=7),
)
def test_search_survives_any_answers(seed, parallelism, answers):
    count = 0

    def evaluate(points):
        nonlocal count
        count += len(points)
        return [Evaluation(answers[(count + at) % len(answers)], failed=False) for at in range(len(points))]

    fields = [SearchField("x", 0.0, 1.0, -10, 10), SearchField("n", 1.0, 1.0, 0, 9, integer=True)]
    result = activate(fields, evaluate, seed=seed, budget=20, parallelism=parallelism)
    assert result.runs == count == 20


@settings(max_examples=25, deadline=None)
@given(st.lists(st.lists(st.floats(), max_size=20), min_size=1, max_size=3), st.integers(0, 1000))
def test_permeability_survives_any_series(outputs, seed):
    signal = Signal(0.0, 1.0, 3, seed=seed)
    runs = []
    for values in outputs:
        times = tuple(float(at) for at in range(len(values)))
        drive = FieldDrive(Series(times, tuple(signal.value(at) for at in range(len(values)))), signal)
        runs.append(Run({"e": drive}, {"i": Series(times, tuple(values))}))
    result = analyse(runs, draws=19, lags=3)
    assert len(result.edges) + len(result.skipped) == 1
    assert all(0 <= edge.low <= edge.strength <= edge.high <= 1 for edge in result.edges)
