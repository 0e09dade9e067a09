"""docs/mavlink.md shows what is so."""

import re
from pathlib import Path

import pytest

from riot_bus.types.listing import describe_named
from riot_bus.types.registry import TypeRegistry
from riot_bus_mavlink.adapter import MavlinkAdapter
from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import pack_frame

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "mavlink.md").read_text()


def test_the_example_in_python_runs(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    extra = load_dialect("common").crc_extra(30)
    who = {"version": 2, "sequence": 1, "system": 7, "component": 1}
    exec(compile(code, "docs/mavlink.md", "exec"), {"data": pack_frame(30, b"\1" * 28, extra, **who)})
    out = capsys.readouterr().out
    assert out.startswith("7 ")
    assert "frames=1" in out


def test_the_fields_of_a_heartbeat():
    listing = describe_named("HEARTBEAT", TypeRegistry([MavlinkAdapter()]))
    shown = re.search(r"riot types HEARTBEAT\n(.*?)\.\.\.\n", PAGE, re.DOTALL)[1]
    assert re.findall(r"^ {6}(\S+)", shown, re.MULTILINE) == [field.path for field in listing.fields[:4]]
    assert f"0..{listing.fields[3].high}" in shown


@pytest.mark.parametrize("short", ["COMMAND_LONG", "255/190/COMMAND_LONG", "255/*/COMMAND_LONG"])
def test_short_names(short):
    assert f"`{short}`" in PAGE
    assert f"`{MavlinkAdapter().key_expression(short)}`" in PAGE
