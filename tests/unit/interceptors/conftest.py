import json

import pytest

from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message

START = 1_700_000_000_000_000_000


class Bench:
    """Feeds messages to interceptors: times in seconds since the first one."""

    def __init__(self, *interceptors):
        self.pipeline = Pipeline(interceptors, registry=TypeRegistry(), start=START)
        self.delivered = []

    def feed(self, seconds=0.0, payload=b'{"x": 1.5}', key="a", **more):
        if not isinstance(payload, bytes):
            payload = json.dumps(payload).encode()
        result = self.pipeline.feed(Message(START + round(seconds * 1e9), key, payload, **more))
        self.delivered += result.emissions
        return result

    def feed_all(self, times, **more):
        return [self.feed(seconds, **more) for seconds in times]

    def times(self):
        """When what was delivered falls due, in order of arrival."""
        return [(emission.due - START) / 1e9 for emission in self.delivered]

    def payloads(self):
        return [emission.message.payload for emission in self.delivered]


@pytest.fixture
def bench():
    """Make a bench of interceptors; at the end, none of them must have raised."""
    made = []

    def make(*interceptors):
        made.append(Bench(*interceptors))
        return made[-1]

    yield make
    for each in made:
        each.pipeline.close()
        assert not each.pipeline.errors
