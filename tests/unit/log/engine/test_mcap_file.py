from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Channel

from riot_bus.log.engine.mcap_file import record_bytes

TEXTS = st.text(max_size=40)


@given(
    number=st.integers(0, (1 << 16) - 1),
    schema=st.integers(0, (1 << 16) - 1),
    topic=TEXTS,
    encoding=TEXTS,
    metadata=st.dictionaries(TEXTS, TEXTS, max_size=5),
)
def test_a_channel_is_written_as_the_library_writes_it(
    number: int, schema: int, topic: str, encoding: str, metadata: dict[str, str]
) -> None:
    channel = Channel(id=number, schema_id=schema, topic=topic, message_encoding=encoding, metadata=metadata)
    builder = RecordBuilder()
    channel.write(builder)
    assert record_bytes(channel) == bytes(builder.end())  # type: ignore[no-untyped-call]
