"""Texts with a structure are changed part by part, with the check sum that the nominal texts have."""

import json
import zlib
from binascii import crc_hqx

import pytest

from riot_bus.campaign.sentences import structured


def nmea(body: str, start: str = "$") -> str:
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"{start}{body}*{total:02X}\r\n"


def summed(body: str) -> str:
    return f"{body}#{sum((body + '#').encode()) & 0xFF:02x}"


def crc16(body: str) -> str:
    return f"{body},{crc_hqx(body.encode(), 0xFFFF):04X}"


def crc32(body: str) -> str:
    return f"{body};{zlib.crc32(body.encode()):08x}"


def values(*texts: str) -> dict[str, str]:
    """Return changed texts by what the change is."""
    return {str(each.reason): str(each.value) for each in structured(texts)}


@pytest.mark.parametrize("write", [nmea, summed, crc16, crc32])
def test_the_check_sum_is_found_and_mended(write) -> None:
    found = values(*(write(f"GPXYZ,{n},5{n}.5,7") for n in range(4)))
    assert found["part 3 is blank"] == write("GPXYZ,0,,7")
    assert found["part 2 is missing"] == write("GPXYZ,50.5,7")
    assert found["part 4 comes twice"] == write("GPXYZ,0,50.5,7,7")
    assert found["part 3 is -50.5"] == write("GPXYZ,0,-50.5,7")
    assert found["parts 2 and 3 are exchanged"] == write("GPXYZ,50.5,0,7")
    assert found["a blank part is added"] == write("GPXYZ,0,50.5,7,")
    assert found["the second half of the parts is missing"] == write("GPXYZ,0")
    wrong = found["the check sum is wrong"]
    assert len(wrong) == len(write("GPXYZ,0,50.5,7"))
    assert wrong != write("GPXYZ,0,50.5,7")
    assert all(
        text == wrong or text == write(text.strip("$\r\n")[:-extra])
        for text in found.values()
        for extra in [{nmea: 3, summed: 3, crc16: 5, crc32: 9}[write]]
    )


def test_each_kind_of_sentence_is_changed() -> None:
    found = [str(each.value) for each in structured([nmea("GPRMC,1,A"), nmea("GPGGA,1,2,3"), nmea("GPRMC,2,V")])]
    assert nmea("GPRMC,,A") in found
    assert nmea("GPGGA,,2,3") in found
    assert nmea("GPRMC,,V") not in found


def test_values_of_keys_are_changed_and_keys_stay() -> None:
    found = values("speed=1;mode=auto", "speed=2;mode=off")
    assert found["part 1 is blank"] == "speed=;mode=auto"
    assert found["part 1 is nan"] == "speed=nan;mode=auto"
    assert found["part 2 is ?"] == "speed=1;mode=?"
    assert found["part 2 is missing"] == "speed=1"


def test_a_number_at_the_end_is_no_check_sum() -> None:
    found = values("a,b,10", "a,c,20")
    assert found["part 3 is blank"] == "a,b,"
    assert "the check sum is wrong" not in found


def test_dates_have_parts() -> None:
    assert values("2026-11-29T12:30:00Z", "2026-11-30T12:31:00Z")["part 2 is blank"] == "2026-11-29T12::00Z"


def test_a_document_within_a_text_is_changed_by_its_fields() -> None:
    found = values(json.dumps({"x": 1.5, "name": "a", "list": [1, 2]}), json.dumps({"x": 2, "name": "b", "list": []}))
    assert json.loads(found["x is null"]) == {"x": None, "name": "a", "list": [1, 2]}
    assert json.loads(found["name is missing"]) == {"x": 1.5, "list": [1, 2]}
    assert json.loads(found["list[1] is 0"]) == {"x": 1.5, "name": "a", "list": [1, 0]}


@pytest.mark.parametrize("texts", [[], ["idle", "moving"], ["left door", "right door"], [""], ["a,b", "c"]])
def test_words_have_no_structure(texts: list[str]) -> None:
    assert list(structured(texts)) == []
