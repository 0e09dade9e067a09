"""What takes long is in one of the parts of the gate, which take about as long as each other."""

import json

from tests import processor_time
from tests.tiers import equal_parts


def test_each_is_in_one_part_and_parts_differ_by_less_than_the_longest():
    seconds = {f"{number}": float(number % 7) for number in range(100)} | {"longest": 30.0}
    parts = equal_parts(seconds)
    assert sorted(name for part in parts for name in part) == sorted(name for name in seconds if seconds[name])
    lengths = [sum(seconds[name] for name in part) for part in parts]
    assert max(lengths) - min(lengths) <= 30.0
    assert sum(length == min(lengths) or length - min(lengths) <= 6.0 for length in lengths) >= 3


def test_tests_that_were_measured_are_there():
    missing = {
        name
        for name in json.loads(processor_time.FILE.read_text(encoding="utf-8"))
        for file, first, *_ in [name.split("::")]
        if not (processor_time.FILE.parents[1] / file).exists()
        or f" {first}(" not in (processor_time.FILE.parents[1] / file).read_text(encoding="utf-8")
    }
    assert not missing
