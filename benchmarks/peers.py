"""Other minimisers on the synthetic logs of noise.py: picire, Shrink Ray, Hypothesis' shrinker, ProbDD.

Each is asked to shrink the numbers 0..n-1 while `fails` holds, and returns what it has come to. picire, shrinkray and
hypothesis are packages of their own (`pip install picire "setuptools<81" shrinkray hypothesis`; Shrink Ray needs Python
3.12); ProbDD is written here after the paper (Wang et al., ESEC/FSE 2021). None of them knows of answers that may be
wrong.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from importlib.util import find_spec
from typing import Any

__all__ = ["PEERS", "explained"]

Kept = tuple[int, ...]
Fails = Callable[[Kept], bool]


def probdd(n: int, fails: Fails) -> Kept:
    """Shrink by ProbDD: leave out what is likely to gain most, and learn from it what is needed."""
    # Of one needed element in all: with the 0.1 of its authors' experiments, a log of 1,000 takes 117 trials or more.
    chance = dict.fromkeys(range(n), 1 / max(2, n))
    while any(one < 1 for one in chance.values()):
        order = sorted((item for item in chance if chance[item] < 1), key=chance.__getitem__)
        best, gain, alone = 0, 0.0, 1.0
        for count, item in enumerate(order, 1):
            alone *= 1 - chance[item]
            if count * alone > gain:
                best, gain = count, count * alone
        left_out = set(order[: max(best, 1)])
        if fails(tuple(item for item in chance if item not in left_out)):
            chance = {item: one for item, one in chance.items() if item not in left_out}
            continue
        none = 1.0
        for item in left_out:
            none *= 1 - chance[item]
        for item in left_out:
            chance[item] = min(1.0, chance[item] / (1 - none)) if none < 1 and len(left_out) > 1 else 1.0
    return tuple(chance)


def picire(n: int, fails: Fails) -> Kept:
    """Shrink by picire in its best mode: complements alone, from the end; what it asks again is asked once."""
    from picire import DD, Outcome, config_iterators

    once = lru_cache(maxsize=None)(fails)

    def test(config: list[int], config_id: object) -> Any:
        return Outcome.FAIL if once(tuple(sorted(config))) else Outcome.PASS

    backward, skip = config_iterators.backward, config_iterators.skip
    search = DD(test, subset_first=False, subset_iterator=skip, complement_iterator=backward)
    return tuple(sorted(search(list(range(n)))))


def shrinkray(n: int, fails: Fails) -> Kept:
    """Shrink by Shrink Ray's passes for sequences, until they change nothing."""
    import trio
    from shrinkray.passes.sequences import block_deletion, delete_duplicates
    from shrinkray.problem import BasicReductionProblem
    from shrinkray.work import WorkContext

    async def interesting(kept: Kept) -> bool:
        return fails(tuple(kept))

    async def run() -> Kept:
        work = WorkContext(parallelism=1)
        problem = BasicReductionProblem(tuple(range(n)), interesting, work=work, sort_key=len, cache_key=repr)
        before = -1
        while before != len(problem.current_test_case):
            before = len(problem.current_test_case)
            size = before // 2
            while size >= 1:
                await block_deletion(size, size)(problem)
                size //= 2
            await delete_duplicates(problem)
        return tuple(problem.current_test_case)

    return trio.run(run)


def hypothesis(n: int, fails: Fails) -> Kept:
    """Shrink by Hypothesis' shrinker: a list of numbers, all of them at first."""
    from hypothesis import HealthCheck, Phase, settings
    from hypothesis.internal.conjecture import engine
    from hypothesis.internal.conjecture.data import Status
    from hypothesis.internal.conjecture.engine import ConjectureRunner, RunIsComplete
    from hypothesis.internal.conjecture.utils import many

    engine.MAX_SHRINKS = 10_000  # it ends after 500 improvements else
    best: list[Kept] = []

    def test(data: Any) -> None:
        with many(data, min_size=0, max_size=n, average_size=n / 2) as elements:
            kept = tuple(sorted({data.draw_integer(0, n - 1) for _ in elements}))
        if fails(kept):
            best.append(kept)
            data.mark_interesting("fails")

    options = settings(
        max_examples=100_000, database=None, deadline=None, phases=[Phase.shrink], suppress_health_check=HealthCheck
    )
    runner = ConjectureRunner(test, settings=options)
    with contextlib.suppress(RunIsComplete):  # after 500 shrinks, or when an answer is another one
        data = runner.cached_test_function([*itertools.chain(*((True, item) for item in range(n))), False])
        if data.status == Status.INTERESTING:
            runner.shrink_interesting_test_cases()
    return min(best, key=len, default=tuple(range(n)))


def explained(names: list[str], fails: Callable[[dict[str, int]], bool], values: list[int], seed: int) -> set[str]:
    """Return what Hypothesis' explain phase does not call irrelevant, of a failure that it finds itself."""
    from hypothesis import HealthCheck, Phase, given, settings
    from hypothesis import seed as seeded
    from hypothesis import strategies as st

    options = settings(
        database=None,
        deadline=None,
        max_examples=10_000,
        suppress_health_check=list(HealthCheck),
        phases=tuple(Phase),
    )

    @seeded(seed)
    @options
    @given(**{name: st.sampled_from(values) for name in names})
    def test(**drawn: int) -> None:
        assert not fails(drawn)

    try:
        test()
    except AssertionError as error:
        told = "\n".join(getattr(error, "__notes__", ())).splitlines()
        return {line.strip().partition("=")[0] for line in told if line.strip().endswith(",")}
    return set()


def _installed(peers: dict[str, Callable[[int, Fails], Kept]]) -> Iterator[tuple[str, Callable[[int, Fails], Kept]]]:
    for name, peer in peers.items():
        if name == "ProbDD" or find_spec(name) is not None:
            yield name, peer
        else:
            yield name, partial(_missing, name)


def _missing(name: str, n: int, fails: Fails) -> Kept:
    raise ModuleNotFoundError(f"{name} is not installed: pip install {name}")


PEERS = dict(_installed({"picire": picire, "shrinkray": shrinkray, "hypothesis": hypothesis, "ProbDD": probdd}))
"""By name; one that is not installed says so when it is called."""

if __name__ == "__main__":
    for name, peer in PEERS.items():
        for n, wanted in itertools.product((1000,), ({517}, {3, 500, 998})):
            asked: list[int] = []

            def fails(kept: Kept, wanted: set[int] = wanted, asked: list[int] = asked) -> bool:
                asked.append(len(kept))
                return wanted <= set(kept)

            print(name, n, wanted, set(peer(n, fails)) == wanted, len(asked))
