"""What adapters and message types can do besides what they must do, each as one optional protocol.

Nothing registers for these: an object that has the methods and attributes of a protocol offers it. What an adapter must
have is `riot_bus.types.model.Adapter`, a type `riot_bus.types.model.MessageType`. Who asks for what: docs/adapters.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from riot_bus.types.fields import FieldType
    from riot_bus.types.model import MessageType, Schema
    from riot_bus.types.payloads import Gathered, Payloads
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Scalar

__all__ = [
    "MOST_PARTS",
    "AllowsNonFinite",
    "Announcement",
    "AnnouncesServers",
    "Ask",
    "ConvertsFiles",
    "DescribesFields",
    "DiscoversTypes",
    "GathersFields",
    "HasServices",
    "HeardSystem",
    "Identity",
    "KnowsBrittleFields",
    "ListensToLinks",
    "ListsParts",
    "ListsTypes",
    "MessagePart",
    "Offer",
    "OmitsFields",
    "ParsesTokens",
    "PublishesAs",
    "ReadsMetadata",
    "ReadsTypesFromKeys",
    "RecordedTopic",
    "Role",
    "SimClock",
    "Stamp",
    "StandIn",
    "SuggestedValue",
    "SuggestsValues",
    "TakesFiles",
    "Unpacker",
    "allows_non_finite",
    "suggested_values",
]

# -- what an adapter can do: types ------------------------------------------------------------------------------------


@runtime_checkable
class TakesFiles(Protocol):
    """Files with these endings define this adapter's types; an adapter without it gets all that no other takes.

    Attributes:
        endings: Such as `(".xml",)`.
    """

    endings: Sequence[str]


@runtime_checkable
class ListsTypes(Protocol):
    """Lists its types; a codec that is a `TypeSource` can do it too."""

    def type_names(self) -> Iterable[str]:
        """Return the names of all types that need no search in files."""
        ...


@runtime_checkable
class ReadsTypesFromKeys(Protocol):
    """Keys say more of a type than its name, such as a hash."""

    def type_of_key(self, key: str) -> MessageType | None:
        """Return the type that a key names, None if the key names none that is known."""
        ...


Ask = Callable[[str, bytes, bytes], Iterable[bytes]]
"""Returns the payloads of the replies to a query, from its key, payload and attachment; in bounded time."""


@runtime_checkable
class DiscoversTypes(Protocol):
    """Asks participants of the bus for types that nothing here defines.

    Both methods may take long, so nothing that handles messages calls them.
    """

    def missing(self, key: str) -> bool:
        """Return whether a key names a type whose definition is not known here, and for which one can ask."""
        ...

    def learn(self, key: str, tokens: Iterable[str], heard: Sequence[bytes], ask: Ask) -> MessageType | None:
        """Ask the users of a key for its type, and remember it; None if none of them knows, or none can be asked now.

        Args:
            key: One that is missing.
            tokens: Keys of all present liveliness tokens.
            heard: Attachments of some messages of the key, which may tell who takes which questions.
            ask: Puts a question.
        """
        ...


# -- what an adapter can do: participants of the bus ------------------------------------------------------------------

Role = Literal["publishes", "subscribes", "serves", "calls"]


@dataclass(frozen=True, slots=True)
class Announcement:
    """What one liveliness token says.

    Attributes:
        zid: Id of the session that made it.
        role: What it announces; None for a node.
        key: Key or key expression; empty for a node.
        node: Full name of the node.
        topic: What people call the topic or service.
        type_name: Its type.
        source: `ros2 token`, `bridge token` or `advanced token`.
        action: The action that the topic or service belongs to, or that is announced itself.
        action_type: Type of that action, as far as the token tells.
    """

    zid: str
    role: Role | None
    key: str
    node: str
    topic: str
    type_name: str
    source: str
    action: str = ""
    action_type: str = ""


@runtime_checkable
class ParsesTokens(Protocol):
    """Reads what nodes, publishers, subscribers, services and actions announce by liveliness tokens.

    Attributes:
        announcements: Key expressions of these tokens.
    """

    announcements: Sequence[str]

    def announcement(self, token: str) -> Announcement | None:
        """Return what a token's key says, None if it is of another kind; never raises."""
        ...


@runtime_checkable
class HasServices(Protocol):
    """The middleware has services; their requests and replies are messages (`riot_bus.types.serve`).

    Attributes:
        services: Key expressions of services whose callers only ask those who call themselves complete
            (Zenoh's target `ALL_COMPLETE`), as all their servers do.
    """

    services: Sequence[str]

    def action_parts(self, name: str) -> str | None:
        """Return what topics and services are called of which an action of this name consists; None if it has none.

        Args:
            name: As people write it; it may have wildcards.
        """
        ...

    def call_type(self, type_name: str, part: str) -> str | None:
        """Return the type of a part of a call, None if it has none.

        Args:
            type_name: Type of the service.
            part: One of `riot_bus.types.serve.PARTS`.
        """
        ...


@runtime_checkable
class AnnouncesServers(Protocol):
    """Says by which liveliness tokens callers know that a service is there: some wait for it before they call."""

    def server_tokens(self, key: str, zid: str, entity: int) -> Sequence[str]:
        """Return the keys of the tokens of a server and its node; empty if the key is none of a service of its kind.

        Args:
            key: Key of the service.
            zid: Id of the Zenoh session that serves it.
            entity: Number of the server in the session, from 1.
        """
        ...


@dataclass(frozen=True, slots=True)
class HeardSystem:
    """What was heard of a system on its links.

    Attributes:
        toml: The text of a first system file.
        facts: What was heard, as JSON values.
        lines: What was heard, for people.
    """

    toml: str
    facts: Mapping[str, Any]
    lines: Sequence[str]


@runtime_checkable
class ListensToLinks(Protocol):
    """Hears systems on links that are none of Zenoh's, for `riot init`."""

    def listen(
        self, links: Sequence[str], *, seconds: float, unit: str | None, warn: Callable[[str], None]
    ) -> HeardSystem:
        """Listen to links for a while; send nothing.

        Args:
            links: As users write them.
            seconds: Time to listen, seconds.
            unit: What is to be tested, as users write it; None if they do not say.
            warn: Called with a line about what does not work.

        Raises:
            ConfigError: A link or the unit is wrong.
            EnvironmentFaultError: A link cannot be opened, or nothing was heard.
        """
        ...


# -- what an adapter can do: logs -------------------------------------------------------------------------------------


class Stamp(NamedTuple):
    """What a message says of itself.

    Attributes:
        sequence: Its number at its publisher; the next one's is one more.
        time: When it was published, nanoseconds since the Unix epoch.
        publisher: Id of that publisher.
    """

    sequence: int
    time: int
    publisher: bytes


@runtime_checkable
class ReadsMetadata(Protocol):
    """Reads what messages and publishers say of themselves, for logs and graphs.

    Attributes:
        tokens: Key expression of the liveliness tokens that announce publishers.
    """

    tokens: str

    def stamp(self, attachment: bytes) -> Stamp | None:
        """Return what an attachment says, None if it is of another kind; never raises."""
        ...

    def details(self, key: str, tokens: Iterable[str]) -> Mapping[str, str]:
        """Return metadata for the key's channel in a log, such as the offered quality of service.

        Args:
            key: One of this adapter's kind.
            tokens: Keys of all present tokens.
        """
        ...

    def definition(self, key: str) -> tuple[Schema, str] | None:
        """Return schema and encoding of a log's channel for a key whose type is not known here; None if there is none.

        Args:
            key: One of this adapter's kind.
        """
        ...


@dataclass(frozen=True, slots=True)
class RecordedTopic:
    """What a log says of a topic.

    Attributes:
        name: What people call it, such as `/odom`.
        key: Its Zenoh key; the name where the log knows no keys.
        keyed: Whether the log knows keys: riot_bus has recorded it.
        schema: The type's definition, empty if there is none.
        encoding: MCAP's message encoding, such as `cdr`.
        details: All that the log's channel says, such as `offered_qos_profiles`.
    """

    name: str
    key: str
    keyed: bool
    schema: Schema
    encoding: str
    details: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Identity:
    """A publisher as its subscribers know it.

    Attributes:
        tokens: Keys of the liveliness tokens that announce it.
        attachment: Returns the attachment of a message, from the recorded one (or None), the message's number at this
            publisher (1, 2, ...) and the present time in nanoseconds.
    """

    tokens: Sequence[str] = ()
    attachment: Callable[[bytes | None, int, int], bytes | None] | None = None


@dataclass(frozen=True, slots=True)
class Offer:
    """How to publish a topic.

    Attributes:
        key: Zenoh key.
        depth: Late joiners get so many of the last messages; None if they get none.
        reliable: Whether what was lost is sent again to those who ask.
        block: Whether a slow subscriber holds up the publisher, whatever was recorded.
        identify: Returns who publishes, from the session's id and the publisher's number in it.
    """

    key: str
    depth: int | None = None
    reliable: bool = True
    block: bool = False
    identify: Callable[[str, int], Identity] | None = None


@dataclass(frozen=True, slots=True)
class SimClock:
    """How time is told to those who follow a simulated clock.

    Attributes:
        name: What people call the topic; a recorded one of this name is not played beside it.
        offer: How to publish it.
        payload: Returns the payload for a time in nanoseconds.
    """

    name: str
    offer: Offer
    payload: Callable[[int], bytes]


@runtime_checkable
class PublishesAs(Protocol):
    """Says how a recorded topic is published again, so that its subscribers take it for the original."""

    def offer(self, topic: RecordedTopic, *, name: str | None, domain: int | None) -> Offer | None:
        """Return how to publish a topic, None if it is not of this adapter's kind.

        Args:
            topic: What was recorded.
            name: Another name for it.
            domain: Another domain for it, in middleware that has such.
        """
        ...

    def clock(self, topics: Sequence[RecordedTopic], *, domain: int | None) -> SimClock | None:
        """Return how to tell the time, None if this middleware has no simulated time.

        Args:
            topics: What is played.
            domain: Another domain than theirs.
        """
        ...


class Unpacker(Protocol):
    """Takes one file apart, piece by piece; never raises on hostile bytes."""

    def feed(self, data: bytes) -> Sequence[Message]:
        """Return the messages that are complete with these bytes, under the keys that they have on the bus."""
        ...

    def end(self) -> Sequence[Message]:
        """Return what is left when the file has ended."""
        ...

    def loss(self) -> str:
        """Return what could not be read so far, empty if nothing."""
        ...


@runtime_checkable
class ConvertsFiles(Protocol):
    """Converts logs from and to files in a format of other tools, one record after another.

    Attributes:
        archives: Endings of such files.
    """

    archives: Sequence[str]

    def unpacker(self) -> Unpacker:
        """Return what takes one file apart."""
        ...

    def packed(self, message: Message) -> bytes | None:
        """Return the record of a message, None if it is of another kind."""
        ...


# -- what a message type can do ---------------------------------------------------------------------------------------


@runtime_checkable
class DescribesFields(Protocol):
    """The payloads of the type always have the same fields."""

    def fields(self) -> Sequence[FieldType]:
        """List the fields in payload order, `riot_bus.types.fields.MOST_FIELDS` at most.

        Raises:
            PayloadError: The type has parts that are not known.
        """
        ...

    def elements(self, payloads: Payloads, path: str) -> Iterator[NDArray[Any]]:
        """Yield the elements of an array of numbers (`ranges`) of many payloads, some payloads at a time.

        Raises:
            PayloadError: There is no such array.
        """
        ...


@runtime_checkable
class GathersFields(Protocol):
    """Finds one field of many payloads at once."""

    def gather(self, payloads: Payloads, path: str) -> Gathered:
        """Return the values that `read` would return; doubtful ones are left to it.

        Raises:
            PayloadError: No payload of this type has such a field.
        """
        ...


MOST_PARTS = 1_000
"""`ListsParts.parts` lists no more than this many parts of one type."""


@dataclass(frozen=True, slots=True)
class MessagePart:
    """A message within others.

    Attributes:
        path: Such as `pose.pose`, or `poses[*].header` for those in each element of an array; empty for the whole.
        type_name: Its type.
    """

    path: str
    type_name: str


@runtime_checkable
class ListsParts(Protocol):
    """Messages of the type are made of messages, so that what is known of a part is used wherever it stands."""

    def parts(self) -> Sequence[MessagePart]:
        """List the whole and all messages in it, outer ones first, `MOST_PARTS` at most.

        Raises:
            PayloadError: The type has parts that are not known.
        """
        ...


@dataclass(frozen=True, slots=True)
class SuggestedValue:
    """One exceptional value, and why it is worth trying."""

    value: Scalar
    reason: str


@runtime_checkable
class SuggestsValues(Protocol):
    """Definitions tell more of values than their type does."""

    def exceptional(self, payload: bytes, path: str) -> Sequence[SuggestedValue]:
        """Return values of a field that are worth trying: unusual, at limits, beyond limits, undefined.

        Args:
            payload: A sample; what a field means may depend on others.
            path: A field of it.

        Returns:
            Values that the field can hold, none if nothing tells or there is no such field.
        """
        ...


def suggested_values(kind: MessageType | None, payload: bytes, path: str) -> Sequence[SuggestedValue]:
    """Return the values that a field's definition suggests, none if its type suggests nothing."""
    return kind.exceptional(payload, path) if isinstance(kind, SuggestsValues) else ()


@runtime_checkable
class KnowsBrittleFields(Protocol):
    """Knows what makes receivers refuse a message."""

    def brittle(self, path: str) -> str | None:
        """Return why a field should be left alone unless it was asked for.

        Returns:
            The reason, empty if it may be changed, None if nothing tells; then its name decides.
        """
        ...


@runtime_checkable
class AllowsNonFinite(Protocol):
    """Knows fields in which NaN or an infinity is a regular value, such as "not known" or "nothing in reach"."""

    def allows_non_finite(self, path: str) -> bool:
        """Return whether a field is such a one.

        Args:
            path: A field, or an element of an array.
        """
        ...


def allows_non_finite(kind: MessageType | None, path: str) -> bool:
    """Return whether NaN or an infinity is a regular value of a field, False if nothing tells."""
    return kind is not None and isinstance(kind, AllowsNonFinite) and kind.allows_non_finite(path)


StandIn = Literal["null", "list", "map"]
"""What may stand in place of a field: null, a list or a map without anything in it."""


@runtime_checkable
class OmitsFields(Protocol):
    """No definition says which fields a payload has: each may be missing, null, or of another type (by `patch`)."""

    def omit(self, payload: bytes, path: str, *, instead: StandIn | None = None) -> bytes:
        """Return the payload without a field of a map (a scalar, a list or a map), or with something in its place.

        Raises:
            PayloadError: There is no such field.
        """
        ...
