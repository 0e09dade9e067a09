"""Which keys reach which subscribers, and how often."""

from __future__ import annotations

from riot_bus_conformance.end import Observation, ScenarioEnd
from riot_bus_conformance.samples import Inbox, keys_of
from riot_bus_conformance.scenario import scenario


class _KeysEnd(ScenarioEnd):
    """An end that publishes on several keys, or says which of them its subscribers got.

    Attributes:
        closing: Keys of the closing messages, one for each subscriber.
    """

    published: tuple[str, ...]
    closing: tuple[str, ...]
    subscribed: tuple[str, ...]

    def left(self) -> Observation:
        self.meet()
        self.put_all()

    def right(self) -> Observation:
        inboxes = {expression: self.subscribe(expression) for expression in self.subscribed}
        self.meet()
        return self.received(inboxes)

    def put_all(self) -> None:
        for number, key in enumerate(self.published):
            self.put(key, str(number))
        for key in self.closing:
            self.finish(key)

    def received(self, inboxes: dict[str, Inbox]) -> dict[str, list[list[str]]]:
        """Return what each inbox received, after waiting for each one, since each has its own thread."""
        return {expression: keys_of(inbox.until_end()) for expression, inbox in inboxes.items()}


@scenario("wildcard_subscribers")
class _WildcardSubscribers(_KeysEnd):
    """Overlapping wildcard subscribers of one session: each gets what it matches, once."""

    published = ("a", "a/x", "a/x/y", "ab/x", "b/x/y/z", "@v/x", "a/@v/x")
    closing = ("a/x", "a")
    subscribed = ("**", "*/x", "a/**", "a$*/x", "*", "a", "**/x/**")


@scenario("wildcard_publications")
class _WildcardPublications(_KeysEnd):
    """Publications on key expressions with wildcards, which reach all that they intersect."""

    published = ("*/x", "a/**", "**", "a/x")
    closing = ("a/x", "b/x")
    subscribed = ("a/x", "b/x", "a/*")


@scenario("verbatim_keys")
class _VerbatimKeys(_KeysEnd):
    """Keys with verbatim chunks, which only a verbatim subscriber gets."""

    published = closing = ("@v/x", "a/@v/x", "a/x")
    subscribed = ("@v/**", "a/@v/*", "**")


@scenario("declared_keys")
class _DeclaredKeys(_KeysEnd):
    """Key expressions that both ends declare beforehand."""

    published = ("long/key/expression", "other")
    closing = ("long/end",)

    def left(self) -> Observation:
        key = self.session.declare_keyexpr(self.key("long/key/expression"))
        publisher = self.keep(self.session.declare_publisher(key))
        self.meet()
        self.matched(publisher)
        self.session.put(key, "1")
        publisher.put("2")
        self.session.undeclare(key)
        self.put_all()

    def right(self) -> Observation:
        declared = self.session.declare_keyexpr(self.key("long/**"))
        self.session.declare_keyexpr(self.key("never/used"))
        named = Inbox()
        named.handle = self.session.declare_subscriber(declared, named)
        inboxes = {"declared": named, "**": self.subscribe("**")}
        self.meet()
        return self.received(inboxes)
