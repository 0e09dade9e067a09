from riot_bus.types.capabilities import Identity, Offer, PublishesAs, RecordedTopic, SimClock
from riot_bus.types.model import Schema


class Naming:
    """An adapter that names topics, no more."""

    name = "naming"

    def topic(self, key):
        return None


class Publishing(Naming):
    def offer(self, topic, *, name, domain):
        return Offer(name or topic.key)

    def clock(self, topics, *, domain):
        return SimClock("/time", Offer("time"), lambda time: b"%d" % time)


def test_adapters_that_can_publish_are_told_from_others():
    assert isinstance(Publishing(), PublishesAs)
    assert not isinstance(Naming(), PublishesAs)


def test_what_an_offer_is_if_nothing_is_said():
    offer = Offer("a")
    assert (offer.depth, offer.reliable, offer.block, offer.identify) == (None, True, False, None)
    assert (Identity().tokens, Identity().attachment) == ((), None)
    assert RecordedTopic("/a", "a", True, Schema("", "", b""), "json").details == {}
