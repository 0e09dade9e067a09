import pytest

from riot_bus_logtools.export.csv_file import text_of


@pytest.mark.parametrize(
    ("value", "text"), [(True, "true"), (False, "false"), (b"\x01\xff", "01ff"), (1, 1), (0.5, 0.5), ("a", "a")]
)
def test_truth_values_and_bytes_become_text(value: object, text: object) -> None:
    assert text_of(value) == text
