from hypothesis import given
from hypothesis import strategies as st

from riot_bus.log.engine.scan import MessageEntry
from riot_bus.log.engine.sorting import OverlapSorter

_BLOCKS = st.lists(st.tuples(st.lists(st.integers(0, 50), max_size=20), st.integers(0, 60)), max_size=12)


def entries(block, times):
    return [MessageEntry(time, (block << 32) + place, 1, 0, time, b"x", None) for place, time in enumerate(times)]


@given(_BLOCKS)
def test_what_is_taken_is_what_sorting_everything_gives(blocks):
    sorter, plain = OverlapSorter(), []
    for number, (times, before) in enumerate(blocks):
        sorter.add(entries(number, times), len(times))
        plain += entries(number, times)
        plain.sort()
        ready = [each for each in plain if each.time < before]
        assert sorter.release(before) == ready
        plain = [each for each in plain if each.time >= before]
        assert (sorter.held > 0) == bool(plain)
    assert sorter.release() == plain
    assert sorter.held == 0


class Counted(MessageEntry):
    """A message that counts how often it is compared."""

    compared = 0

    def __lt__(self, other):
        Counted.compared += 1
        return tuple(self) < tuple(other)


def test_many_blocks_of_one_time_are_not_sorted_again_for_each(monkeypatch):
    monkeypatch.setattr(Counted, "compared", 0)
    sorter, count = OverlapSorter(), 2000
    found = []
    for number in range(count):
        sorter.add([Counted(number, number, 1, 0, number, b"x", None)], 1)
        found += sorter.release(0)
    found += sorter.release()
    assert [each.time for each in found] == list(range(count))
    assert Counted.compared <= 2 * count  # where all that waited was sorted for each block, it was half its square


def test_what_is_gone_is_no_longer_held():
    sorter = OverlapSorter()
    sorter.add(entries(0, range(1000)), 1000)
    before = sorter.held
    assert len(sorter.release(900)) == 900
    assert sorter.held < before / 5
