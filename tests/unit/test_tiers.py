"""What takes long is in one of the parts of the gate, which take about as long as each other."""

import json

from tests import processor_time
from tests.tiers import PARTS, of_other_parts


def test_each_is_in_one_part_and_parts_differ_by_less_than_the_longest():
    seconds = {f"{number}": float(1 + number % 7) for number in range(100)}
    parts = [seconds.keys() - of_other_parts(seconds, part) for part in range(PARTS)]
    assert sorted(name for part in parts for name in part) == sorted(seconds)
    lengths = [sum(seconds[name] for name in part) for part in parts]
    assert max(lengths) - min(lengths) <= max(seconds.values())


def test_tests_that_were_measured_are_there():
    missing = {
        name
        for name in json.loads(processor_time.FILE.read_text(encoding="utf-8"))
        for file, first, *_ in [name.partition("[")[0].split("::")]
        if not (processor_time.FILE.parents[1] / file).exists()
        or first not in (processor_time.FILE.parents[1] / file).read_text(encoding="utf-8")
    }
    assert not missing
