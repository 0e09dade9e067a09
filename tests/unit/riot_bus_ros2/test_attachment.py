import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.types.capabilities import Stamp
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.attachment import Attachment, build_attachment, parse_attachment, stamp_of

GID = bytes(range(16))
V2 = struct.pack("<qqB", 5, 1_700_000_000_000_000_000, 16) + GID
V1 = (
    b"\x0fsequence_number"
    + struct.pack("<q", 5)
    + b"\x10source_timestamp"
    + struct.pack("<q", 1_700_000_000_000_000_000)
    + b"\x0asource_gid\x10"
    + GID
)


@pytest.mark.parametrize(("data", "version", "size"), [(V2, 2, 33), (V1, 1, 77)])
def test_both_versions(data, version, size):
    assert len(data) == size
    parsed = parse_attachment(data)
    assert parsed == Attachment(5, 1_700_000_000_000_000_000, GID, version)
    assert build_attachment(parsed) == data
    assert stamp_of(data) == Stamp(5, 1_700_000_000_000_000_000, GID)


@pytest.mark.parametrize(
    "data", [b"", V2[:-1], V1 + b"\0", V2[:16] + b"\x0f" + GID, V1.replace(b"gid", b"gdi"), bytes(33), bytes(77)]
)
def test_other_bytes(data):
    with pytest.raises(PayloadError, match="not an attachment of rmw_zenoh"):
        parse_attachment(data)
    assert stamp_of(data) is None


@given(st.binary(max_size=80) | st.binary(min_size=33, max_size=33) | st.binary(min_size=77, max_size=77))
def test_hostile_bytes(data):
    try:
        parsed = parse_attachment(data)
    except PayloadError:
        return
    assert build_attachment(parsed) == data


@pytest.mark.parametrize(
    "bad", [Attachment(1 << 63, 0, GID), Attachment(0, 1 << 63, GID, 1), Attachment(0, 0, b"short")]
)
def test_numbers_that_do_not_fit(bad):
    with pytest.raises(PayloadError):
        build_attachment(bad)


@given(
    st.builds(
        Attachment,
        st.integers(-(1 << 63), (1 << 63) - 1),
        st.integers(-(1 << 63), (1 << 63) - 1),
        st.binary(min_size=16, max_size=16),
        st.sampled_from([1, 2]),
    )
)
def test_what_is_built_is_read(attachment):
    data = build_attachment(attachment)
    assert parse_attachment(data) == attachment
    assert len(data) == {1: 77, 2: 33}[attachment.version]
