from riot_bus.types.model import Schema
from riot_bus.types.offer import Identity, Offer, Offering, RecordedTopic, SimClock


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
    assert isinstance(Publishing(), Offering)
    assert not isinstance(Naming(), Offering)


def test_what_an_offer_is_if_nothing_is_said():
    offer = Offer("a")
    assert (offer.depth, offer.reliable, offer.block, offer.identify) == (None, True, False, None)
    assert (Identity().tokens, Identity().attachment) == ((), None)
    assert RecordedTopic("/a", "a", True, Schema("", "", b""), "json").details == {}
