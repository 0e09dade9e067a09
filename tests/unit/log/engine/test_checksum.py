import subprocess
import sys
import zlib

from hypothesis import given
from hypothesis import strategies as st

from riot_bus.log.engine.checksum import crc32

WITHOUT = """
import sys, zlib
sys.modules["isal"] = None
from riot_bus.log.engine.checksum import crc32
assert crc32 is zlib.crc32
"""


@given(st.binary(max_size=300), st.binary(max_size=300), st.integers(0, 500))
def test_it_is_the_checksum_of_zlib(first, second, repeats):
    assert crc32(first * repeats) == zlib.crc32(first * repeats)
    assert crc32(memoryview(second), crc32(first)) == zlib.crc32(first + second)


def test_zlib_stands_in_where_it_is_missing():
    assert subprocess.run([sys.executable, "-c", WITHOUT], check=False).returncode == 0
