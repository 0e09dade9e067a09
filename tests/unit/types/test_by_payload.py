"""What was worked out of a payload is kept, by type and checksum."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from riot_bus.types.by_payload import ByPayload
from riot_bus.types.model import MessageType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message

messages = st.lists(
    st.builds(
        Message,
        st.just(0),
        st.sampled_from("ab"),
        st.sampled_from([b"1", b"2", b"{}", b""]),
        encoding=st.sampled_from(["", "application/json"]),
    ),
    max_size=30,
)


@given(messages, st.integers(1, 4))
def test_it_is_what_the_function_makes_of_it(log: list[Message], most: int) -> None:
    registry, asked = TypeRegistry(), list[tuple[int, bytes]]()

    def make(kind: MessageType | None, payload: bytes) -> tuple[MessageType | None, bytes]:
        asked.append((id(kind), payload))
        return kind, payload

    kept = ByPayload(make, most=most)
    for message in log:
        kind = registry.type_of(message.key, payload=message.payload, encoding=message.encoding)
        assert kept(message, registry) == (kind, message.payload)
    if len(set(asked)) <= most:
        assert len(asked) == len(set(asked))
