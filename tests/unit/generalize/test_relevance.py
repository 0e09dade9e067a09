import math
import random
from collections.abc import Callable, Mapping, Sequence

import pytest

from riot_bus.generalize.oracle import same_scalar
from riot_bus.generalize.relevance import FieldSpace, relevant_fields
from riot_bus.statistics.noise import Noise
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Scalar

Values = Mapping[str, Scalar]
INT = (0, 1, -1, 7, 100, 2**31 - 1, -(2**31), 35, 120, 240, 300)


class Recorder:
    def __init__(self, fails: Callable[[Values], bool]) -> None:
        self.fails = fails
        self.asked: list[dict[str, Scalar]] = []

    def __call__(self, questions: Sequence[Values]) -> list[bool]:
        self.asked += [dict(question) for question in questions]
        return [self.fails(question) for question in questions]


def with_others(*fields: FieldSpace, count: int = 40) -> list[FieldSpace]:
    others = [FieldSpace(f"other{index}", index, None, (0, 1, 2, 3)) for index in range(count)]
    return [*others[: count // 2], *fields, *others[count // 2 :]]


def product(limit: int) -> Callable[[Values], bool]:
    return lambda q: int(q["x"]) * int(q["y"]) < 0 or int(q["x"]) * int(q["y"]) > limit  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("start", [-1, -(2**31), 2**31 - 1])
def test_a_product_has_both_factors(start: int, seed: int) -> None:
    ask = Recorder(product(4194304))
    fields = with_others(FieldSpace("x", start, 150, INT), FieldSpace("y", 200, None, INT))
    result = relevant_fields(fields, ask, seed=seed, straight=16)
    assert {field.name for field in result.fields} == {"x", "y"}
    assert next(field.kind for field in result.fields if field.name == "x") == "exceptional"
    for field in result.fields:
        failing, passing = field.certificate.failing, field.certificate.passing
        assert [name for name in failing if not same_scalar(failing[name], passing[name])] == [field.name]
        assert dict(failing) in ask.asked
        assert dict(passing) in ask.asked
        assert product(4194304)(failing)
        assert not product(4194304)(passing)


@pytest.mark.parametrize("seed", range(6))
def test_signs_that_hide_each_other(seed: int) -> None:
    fields = with_others(FieldSpace("x", -5, None, (-3, -2, 2, 3)), FieldSpace("y", 5, None, (-3, -2, 2, 3)))
    result = relevant_fields(fields, Recorder(lambda q: int(q["x"]) * int(q["y"]) < 0), seed=seed, straight=20)
    assert {field.name for field in result.fields} == {"x", "y"}


def test_a_mode_field_is_nominal_and_the_injected_one_exceptional() -> None:
    fields = with_others(
        FieldSpace("speed", 1e9, 3.0, (0.0, -1.0, math.nan, 1e9)),
        FieldSpace("mode", "auto", None, ("manual", "off", "auto")),
        FieldSpace("unneeded", math.nan, 1.0, (0.0,)),
    )
    result = relevant_fields(fields, Recorder(lambda q: float(q["speed"]) > 100 and q["mode"] == "auto"), seed=3)
    assert {field.name: field.kind for field in result.fields} == {"speed": "exceptional", "mode": "nominal"}
    assert result.straight == 60
    assert result.bound == pytest.approx(math.log(20) / 60)
    assert result.complete


def test_values_are_compared_by_their_bits() -> None:
    fields = [
        FieldSpace("zero", -0.0, 0.0, (0.0,)),
        FieldSpace("flag", True, None, (1, True)),
        FieldSpace("nan", math.nan, math.nan, (math.nan,)),
    ]

    def fails(question: Values) -> bool:
        return math.copysign(1, float(question["zero"])) < 0 and question["flag"] is True

    result = relevant_fields(fields, Recorder(fails), seed=0)
    assert {field.name for field in result.fields} == {"zero", "flag"}


def test_five_thousand_fields_take_few_trials() -> None:
    fields = with_others(
        FieldSpace("x", -1, 4, (1, 2)), FieldSpace("a", 3, None, (4, 5)), FieldSpace("b", 3, None, (4, 5)), count=4997
    )
    ask = Recorder(lambda q: q["x"] == -1 and q["a"] == 3 and q["b"] == 3)
    result = relevant_fields(fields, ask, seed=1, noise=Noise.after(4, 4))
    assert {field.name for field in result.fields} == {"x", "a", "b"}
    assert result.trials <= 60 + 12 + 50


def test_parallel_search_finds_the_same_fields() -> None:
    fields = with_others(FieldSpace("x", -1, 150, INT), FieldSpace("y", 200, None, INT))
    result = relevant_fields(fields, Recorder(product(10**6)), seed=5, straight=16, parallelism=6)
    assert {field.name for field in result.fields} == {"x", "y"}


def test_equal_seeds_ask_equal_questions() -> None:
    fields = with_others(FieldSpace("x", -1, 150, INT), FieldSpace("y", 200, None, INT))
    first, second = Recorder(product(10**6)), Recorder(product(10**6))
    one, other = (relevant_fields(fields, ask, seed=5) for ask in (first, second))
    assert (one.fields, one.trials, one.straight) == (other.fields, other.trials, other.straight)
    assert first.asked == second.asked


def test_failing_values_that_pass_are_inconclusive() -> None:
    with pytest.raises(InconclusiveError, match="does not fail"):
        relevant_fields([FieldSpace("x", 1, 2, (3,))], Recorder(lambda q: False), seed=0)


def test_a_failure_that_needs_nothing_has_no_fields() -> None:
    result = relevant_fields([FieldSpace("x", 1, 2, (3,))], Recorder(lambda q: True), seed=0)
    assert result.fields == ()


def test_names_must_differ() -> None:
    with pytest.raises(ValueError, match="distinct"):
        relevant_fields([FieldSpace("x", 1, 2, ()), FieldSpace("x", 1, 2, ())], Recorder(lambda q: True), seed=0)


def test_a_passing_base_is_left_after_eight_draws_with_other_causes() -> None:
    causes = [FieldSpace(f"y{index}", 0, None, tuple(range(20))) for index in range(60)]
    ask = Recorder(lambda q: q["x"] == 5 or any(q[field.name] == 7 for field in causes))
    result = relevant_fields([FieldSpace("x", 5, 0, (5,)), *causes], ask, seed=0)
    assert result.fields[0].name == "x"
    assert 8 <= len(result.fields) - 1 < 60


@pytest.mark.parametrize(("p", "eps", "most"), [(0.9, 0.01, 150), (0.7, 0.01, 220), (0.3, 0.0, 500)])
def test_unreliable_failures_take_more_trials_and_come_out_right(p: float, eps: float, most: int) -> None:
    right, trials = 0, []
    for seed in range(8):
        chance = random.Random(seed)
        fields = with_others(FieldSpace("x", -1, 4, (1, 2)), FieldSpace("mode", 3, None, (4, 5)))

        def ask(questions: Sequence[Values], chance: random.Random = chance) -> list[bool]:
            triggers = [question["x"] == -1 and question["mode"] == 3 for question in questions]
            return [chance.random() < (p if one else eps) for one in triggers]

        known = Noise.after(round(10 * p), 10, nominal_total=4)
        result = relevant_fields(fields, ask, seed=seed, noise=known)
        right += {field.name for field in result.fields} == {"x", "mode"}
        trials.append(result.trials)
    assert right >= 7
    assert sorted(trials)[4] <= most


def test_a_draw_counts_as_one_without_effect_only_once_it_has_failed() -> None:
    chance, failed = random.Random(4), set()

    def ask(questions: Sequence[Values]) -> list[bool]:
        answers = [question["x"] == -1 and chance.random() < 0.6 for question in questions]
        failed.update(tuple(one.values()) for one, answer in zip(questions, answers, strict=True) if answer)
        return answers

    fields = with_others(FieldSpace("x", -1, 4, (1, 2)))
    result = relevant_fields(fields, ask, seed=0, noise=Noise.after(6, 10, nominal_total=4))
    assert [field.name for field in result.fields] == ["x"]
    assert result.straight == 60
    assert len(failed) >= 60


def test_spent_trials_leave_what_was_found() -> None:
    fields = with_others(FieldSpace("x", -1, 4, (1, 2)), FieldSpace("mode", 3, None, (4, 5)))
    ask = Recorder(lambda q: q["x"] == -1 and q["mode"] == 3)
    result = relevant_fields(fields, ask, seed=0, noise=Noise.after(4, 4), budget=30)
    assert {field.name for field in result.fields} == {"x", "mode"}
    assert not result.complete
    assert result.trials == len(ask.asked) == 30
    assert 0 < result.straight < 30
    assert result.bound == pytest.approx(min(1.0, math.log(20) / result.straight))
    nothing = relevant_fields(fields, ask, seed=0, noise=Noise.after(4, 4), budget=1)
    assert (nothing.fields, nothing.bound, nothing.straight) == ((), 1.0, 0)


def test_a_value_of_its_own_that_fails_is_not_called_nominal() -> None:
    """The log fails by x; y fails too at a value that it has not there, which is found around passing values."""
    fields = with_others(
        FieldSpace("x", 9, 1, (9, 1)), FieldSpace("y", 0, None, (7, 0)), FieldSpace("z", 0, None, (5, 0), observed=(5,))
    )
    ask = Recorder(lambda q: q["x"] == 9 or q["y"] == 7 or q["z"] == 5)
    kinds = {one.name: one.kind for one in relevant_fields(fields, ask, seed=2, noise=Noise.after(4, 4)).fields}
    assert kinds == {"x": "exceptional", "y": "exceptional", "z": "nominal"}


def test_an_outcome_that_was_wrong_at_the_start_is_mended() -> None:
    """The first trial with nominal values fails though they heal: without mending, no later answer makes sense."""
    fields = with_others(FieldSpace("x", -1, 4, (1, 2)), FieldSpace("mode", 3, None, (4, 5)))
    asked = []

    def ask(questions: Sequence[Values]) -> list[bool]:
        asked.extend(questions)
        return [len(asked) == 2 or (q["x"] == -1 and q["mode"] == 3) for q in questions]

    result = relevant_fields(fields, ask, seed=4, noise=Noise.after(4, 4))
    assert {field.name for field in result.fields} == {"x", "mode"}
    assert result.complete
