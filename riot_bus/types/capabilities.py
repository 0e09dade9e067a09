"""Optional capabilities of adapters and message types, each as one protocol.

No registration is needed: an object with the methods and attributes of a protocol has the capability. The mandatory
protocols are `riot_bus.types.model.Adapter` and `riot_bus.types.model.MessageType`. docs/adapters.md tells which part
of riot uses which capability.
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
    from riot_bus.types.port import SegmentAccess
    from riot_bus.vocabulary.message import Message, Scalar

# -- what an adapter can do: types ------------------------------------------------------------------------------------


@runtime_checkable
class TakesFiles(Protocol):
    """Files with these endings define this adapter's types; adapters without it get all files that no other takes.

    Attributes:
        endings: Endings of file names, such as `(".xml",)`.
    """

    endings: Sequence[str]


@runtime_checkable
class ListsTypes(Protocol):
    """Lists its types; a codec that is a `TypeSource` can do so too."""

    def type_names(self) -> Iterable[str]:
        """Return the names of all types that are known without searching files."""


@runtime_checkable
class ReadsTypesFromKeys(Protocol):
    """Reads more about a type from a key than its name, such as a hash."""

    def type_of_key(self, key: str) -> MessageType | None:
        """Return the type that a key names, None if it names no known type."""


Ask = Callable[[str, bytes, bytes], Iterable[bytes]]
"""Function that sends a query (key, payload, attachment) and returns the payloads of the replies, in bounded time."""


@runtime_checkable
class DiscoversTypes(Protocol):
    """Asks participants of the bus for types without a local definition.

    Both methods may take long, so nothing that handles messages calls them.
    """

    def missing(self, key: str) -> bool:
        """Return whether a key names a type without a known definition that participants can be asked for."""

    def learn(self, key: str, tokens: Iterable[str], heard: Sequence[bytes], ask: Ask) -> MessageType | None:
        """Ask the users of a key for its type, and remember it; None if none of them knows, or none can be asked now.

        Args:
            key: Key whose type is `missing`.
            tokens: Keys of all present liveliness tokens.
            heard: Attachments of some messages of the key, which may tell which participant answers which query.
            ask: Function that sends a query.
        """


# -- what an adapter can do: participants of the bus ------------------------------------------------------------------

MOST_TOKENS = 50_000
"""Most liveliness tokens that are kept of a network: anyone may declare them, and each takes 300 bytes."""

Role = Literal["publishes", "subscribes", "serves", "calls"]


@dataclass(frozen=True, slots=True)
class Announcement:
    """Contents of one liveliness token.

    Attributes:
        zid: Id of the session that declared it.
        role: Role of the announced participant; None for a node.
        key: Key or key expression; empty for a node.
        node: Full name of the node.
        topic: Name of the topic or service.
        type_name: Type of the topic or service.
        source: Kind of token: `ros2 token`, `bridge token` or `advanced token`.
        action: The action to which the topic or service belongs, or that is announced itself.
        action_type: Type of that action, if the token contains it.
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
    """Reads the liveliness tokens of nodes, publishers, subscribers, services and actions.

    Attributes:
        announcements: Key expressions of these tokens.
    """

    announcements: Sequence[str]

    def announcement(self, token: str) -> Announcement | None:
        """Return the announcement in a token's key, None if it is of another kind; never raise."""


@runtime_checkable
class HasServices(Protocol):
    """The middleware has services; their requests and replies are messages (`riot_bus.types.serve`).

    Attributes:
        services: Key expressions of services whose servers all declare themselves complete, and whose callers query
            only complete servers (Zenoh's target `ALL_COMPLETE`).
    """

    services: Sequence[str]

    def action_parts(self, name: str) -> str | None:
        """Return the name of the topics and services of an action; None if it has none.

        Args:
            name: Name of the action as users write it; may contain wildcards.
        """

    def call_type(self, type_name: str, part: str) -> str | None:
        """Return the type of a part of a call, None if it has none.

        Args:
            type_name: Type of the service.
            part: One of `riot_bus.types.serve.PARTS`.
        """


@runtime_checkable
class AnnouncesServers(Protocol):
    """Makes the liveliness tokens that announce a service, for which some callers wait before they call."""

    def server_tokens(self, key: str, zid: str, entity: int) -> Sequence[str]:
        """Return the keys of the tokens of a server and its node; empty if the key is not a service of this adapter.

        Args:
            key: Key of the service.
            zid: Id of the Zenoh session that serves it.
            entity: Number of the server in the session, from 1.
        """


@dataclass(frozen=True, slots=True)
class ParameterRequest:
    """Values for parameters of a running participant.

    Attributes:
        node: Name of the participant.
        values: Values by name; a float stays a float, though it is a whole number.
        ports: The segments on one of which it is.
        timeout: Seconds within which it has to answer.
        alive: Function that returns whether the system still runs; if not, waiting ends.
    """

    node: str
    values: Mapping[str, Scalar]
    ports: Sequence[SegmentAccess]
    timeout: float
    alive: Callable[[], bool]


@runtime_checkable
class SetsParameters(Protocol):
    """Sets parameters of running participants, such as nodes of ROS 2."""

    def has_parameters(self, node: str) -> bool:
        """Return whether a text names a participant of this kind, such as `/planner`."""

    def set_parameters(self, request: ParameterRequest) -> Mapping[str, str]:
        """Set parameters of a participant, and wait until it says what it has done.

        Args:
            request: The participant and its new values.

        Returns:
            The parameters that it has refused, each with the reason; empty if the system has ended.

        Raises:
            ConfigError: A value is of a type that the parameter cannot have.
            EnvironmentFaultError: It has not answered in time.
        """


@dataclass(frozen=True, slots=True)
class HeardSystem:
    """What was learnt about a system by listening to its links.

    Attributes:
        toml: Text of a first system file.
        facts: Findings as JSON values.
        lines: Findings as lines of text for users.
    """

    toml: str
    facts: Mapping[str, Any]
    lines: Sequence[str]


@runtime_checkable
class ListensToLinks(Protocol):
    """Listens to systems on links other than Zenoh's; `riot init` finds it by entry points `riot_bus.listeners`."""

    def listen(
        self, links: Sequence[str], *, seconds: float, unit: str | None, warn: Callable[[str], None]
    ) -> HeardSystem:
        """Listen to links for a while; send nothing.

        Args:
            links: Links as users write them.
            seconds: Time to listen, in seconds.
            unit: Unit to test, as users write it; None if they do not name one.
            warn: Function that is called with a line about each problem.

        Raises:
            ConfigError: A link or the unit is wrong.
            EnvironmentFaultError: A link cannot be opened, or nothing was heard.
        """


# -- what an adapter can do: logs -------------------------------------------------------------------------------------


class Stamp(NamedTuple):
    """Metadata that a message carries.

    Attributes:
        sequence: Sequence number at its publisher, incremented by one for each message.
        time: Time of publication, in nanoseconds since the Unix epoch.
        publisher: Id of the publisher.
    """

    sequence: int
    time: int
    publisher: bytes


@runtime_checkable
class ReadsMetadata(Protocol):
    """Reads metadata of messages and publishers, for logs and graphs.

    Attributes:
        tokens: Key expression of the liveliness tokens that announce publishers.
    """

    tokens: str

    def stamp(self, attachment: bytes) -> Stamp | None:
        """Return the metadata in an attachment, None if it is of another kind; never raise."""

    def details(self, key: str, tokens: Iterable[str]) -> Mapping[str, str]:
        """Return metadata for the key's channel in a log, such as the offered quality of service.

        Args:
            key: A key of this adapter.
            tokens: Keys of all present tokens.
        """

    def definition(self, key: str) -> tuple[Schema, str] | None:
        """Return schema and encoding of a log's channel for a key of unknown type; None if there is none.

        Args:
            key: A key of this adapter.
        """


@dataclass(frozen=True, slots=True)
class RecordedTopic:
    """A topic as a log describes it.

    Attributes:
        name: Name of the topic, such as `/odom`.
        key: Its Zenoh key; the name if the log has no keys.
        keyed: Whether the log has keys, which means that riot_bus recorded it.
        schema: Definition of the type, empty if there is none.
        encoding: Message encoding of MCAP, such as `cdr`.
        details: Metadata of the log's channel, such as `offered_qos_profiles`.
    """

    name: str
    key: str
    keyed: bool
    schema: Schema
    encoding: str
    details: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Identity:
    """The identity of a publisher as its subscribers see it.

    Attributes:
        tokens: Keys of the liveliness tokens that announce it.
        attachment: Function that returns the attachment of a message, from the recorded one (or None), the sequence
            number at this publisher (1, 2, ...) and the present time in nanoseconds.
    """

    tokens: Sequence[str] = ()
    attachment: Callable[[bytes | None, int, int], bytes | None] | None = None


@dataclass(frozen=True, slots=True)
class Offer:
    """How to publish a topic of a recording again.

    Attributes:
        key: Zenoh key.
        depth: Number of last messages that late joiners get; None if they get none.
        reliable: Whether subscribers can detect lost messages and get them again; without effect if `depth` is None.
        block: Whether the publisher waits for slow subscribers even where the recorded QoS would drop messages.
        identify: Function that returns the publisher's identity, from the id of the Zenoh session and the number of the
            publisher in this session (1, 2, ...).
    """

    key: str
    depth: int | None = None
    reliable: bool = True
    block: bool = False
    identify: Callable[[str, int], Identity] | None = None


@dataclass(frozen=True, slots=True)
class SimClock:
    """A clock topic for nodes that follow simulated time.

    Attributes:
        name: Name of the topic; a recorded topic of this name is not played in addition.
        offer: Delivery settings with which to publish it.
        payload: Function that returns the payload for a time in nanoseconds.
    """

    name: str
    offer: Offer
    payload: Callable[[int], bytes]


@runtime_checkable
class PublishesAs(Protocol):
    """Tells how to publish a recorded topic so that its subscribers take it for the original."""

    def offer(self, topic: RecordedTopic, *, name: str | None, domain: int | None) -> Offer | None:
        """Return how to publish a topic, None if it does not belong to this adapter.

        Args:
            topic: The recorded topic.
            name: Another name for it.
            domain: Another domain for it, in middleware with domains.
        """

    def clock(self, topics: Sequence[RecordedTopic], *, domain: int | None) -> SimClock | None:
        """Return how to publish the time, None if this middleware has no simulated time.

        Args:
            topics: Topics that are played.
            domain: Domain to use instead of theirs.
        """


class Unpacker(Protocol):
    """Decodes one file piece by piece; never raises on hostile bytes."""

    def feed(self, data: bytes) -> Sequence[Message]:
        """Return the messages that these bytes complete, under the keys that they have on the bus."""

    def end(self) -> Sequence[Message]:
        """Return the remaining messages at the end of the file."""

    def loss(self) -> str:
        """Return a description of what could not be read so far; empty if nothing was lost."""


@runtime_checkable
class ConvertsFiles(Protocol):
    """Converts logs from and to files in a format of other tools, one record after another.

    Attributes:
        archives: Endings of such files.
    """

    archives: Sequence[str]

    def unpacker(self) -> Unpacker:
        """Return a new decoder for one file."""

    def packed(self, message: Message) -> bytes | None:
        """Return the record of a message, None if it is of another kind."""


# -- what a message type can do ---------------------------------------------------------------------------------------


@runtime_checkable
class DescribesFields(Protocol):
    """Describes its fields, which are the same in all payloads of the type."""

    def fields(self) -> Sequence[FieldType]:
        """List the fields in payload order, `riot_bus.types.fields.MOST_FIELDS` at most.

        Raises:
            PayloadError: The type has unknown parts.
        """

    def elements(self, payloads: Payloads, path: str) -> Iterator[NDArray[Any]]:
        """Yield the elements of an array of numbers in many payloads, in one-dimensional arrays.

        Each yielded array has the elements of one or more whole payloads, which may come in another order. Payloads
        that cannot be decoded are left out.

        Args:
            payloads: Payloads of this type.
            path: Path of the array without `[*]`, such as `ranges`.

        Raises:
            PayloadError: There is no such array.
        """


@runtime_checkable
class GathersFields(Protocol):
    """Finds one field of many payloads at once."""

    def gather(self, payloads: Payloads, path: str) -> Gathered:
        """Return the values that `read` would return; payloads marked as doubtful are left to `read`.

        Raises:
            PayloadError: No payload of this type has such a field.
        """


MOST_PARTS = 1_000
"""Largest number of parts of one type that `ListsParts.parts` lists."""


@dataclass(frozen=True, slots=True)
class MessagePart:
    """A message nested in another one.

    Attributes:
        path: Path such as `pose.pose`, or `poses[*].header` for each element of an array; empty for the whole message.
        type_name: Type of the nested message.
    """

    path: str
    type_name: str


@runtime_checkable
class ListsParts(Protocol):
    """Lists nested messages, so that knowledge about a nested type is used wherever the type occurs."""

    def parts(self) -> Sequence[MessagePart]:
        """List the whole message and all messages in it, outer ones first, `MOST_PARTS` at most.

        Raises:
            PayloadError: The type has unknown parts.
        """


@dataclass(frozen=True, slots=True)
class SuggestedValue:
    """One exceptional value, and why it is worth trying."""

    value: Scalar
    reason: str


@runtime_checkable
class SuggestsValues(Protocol):
    """Suggests values of fields from definitions that say more than the field's type."""

    def exceptional(self, payload: bytes, path: str) -> Sequence[SuggestedValue]:
        """Return values of a field that are worth trying: unusual, at limits, beyond limits, undefined.

        Args:
            payload: Sample payload, since the meaning of a field may depend on others.
            path: Path of a field in it.

        Returns:
            Values that the field can hold, empty if there are no suggestions or no such field.
        """


def suggested_values(kind: MessageType | None, payload: bytes, path: str) -> Sequence[SuggestedValue]:
    """Return the values that a field's definition suggests, empty if its type makes no suggestions."""
    return kind.exceptional(payload, path) if isinstance(kind, SuggestsValues) else ()


@runtime_checkable
class KnowsBrittleFields(Protocol):
    """Knows fields whose change makes receivers reject a message."""

    def brittle(self, path: str) -> str | None:
        """Return why a field should be left alone unless the user names it.

        Returns:
            The reason, empty if the field may be changed, None if unknown; then its name decides.
        """


@runtime_checkable
class AllowsNonFinite(Protocol):
    """Knows fields in which NaN or an infinity is a regular value, such as "not known" or "nothing in reach"."""

    def allows_non_finite(self, path: str) -> bool:
        """Return whether NaN or an infinity is a regular value of a field.

        Args:
            path: Path of a field or of an array element.
        """


def allows_non_finite(kind: MessageType | None, path: str) -> bool:
    """Return whether NaN or an infinity is a regular value of a field, False if unknown."""
    return kind is not None and isinstance(kind, AllowsNonFinite) and kind.allows_non_finite(path)


StandIn = Literal["null", "list", "map"]
"""Replacement of a field: null, an empty list or an empty map."""


@runtime_checkable
class OmitsFields(Protocol):
    """Has fields without a definition: each may be missing, null, or of another type (by `patch`)."""

    def omit(self, payload: bytes, path: str, *, instead: StandIn | None = None) -> bytes:
        """Return the payload without a field of a map (a scalar, a list or a map), or with a replacement for it.

        Raises:
            PayloadError: There is no such field.
        """
