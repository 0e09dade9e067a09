import pytest

from riot_bus_testkit.interceptors import InterceptorBench


@pytest.fixture
def bench():
    """Make a bench of interceptors; at the end, none of them must have raised."""
    made = []

    def make(*interceptors):
        made.append(InterceptorBench(*interceptors))
        return made[-1]

    yield make
    for each in made:
        each.pipeline.close()
        assert not each.pipeline.errors
