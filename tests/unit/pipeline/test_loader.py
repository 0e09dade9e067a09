import pytest

from riot_bus.pipeline.loader import load_class
from riot_bus.vocabulary.errors import ConfigError

ONE = """
from dataclasses import dataclass
from riot_bus.pipeline.event import Event

class Helper:
    pass

@dataclass
class Slow:
    seconds: float = 1.0
    def message(self, event: Event) -> None:
        event.delay(self.seconds)
"""


@pytest.fixture
def file(tmp_path):
    return tmp_path / "mine.py"


def test_the_only_class_needs_no_name(file):
    file.write_text(ONE)
    assert load_class(str(file)).__name__ == "Slow"
    assert load_class(f"{file}:Slow")().seconds == 1.0


@pytest.mark.parametrize(
    ("text", "suffix", "where", "problem"),
    [
        ("def f(:\n", "", ":1", "syntax error"),
        ("x = 1\n1 / 0\n", "", ":2", "ZeroDivisionError"),
        ("x = 1\n", "", "", "no class with a method message()"),
        (ONE, ":Slwo", "", "'Slow'"),
        (ONE + "\nclass Fast(Slow):\n    def message(self, event): pass\n", "", "", "Slow (line 11), Fast (line 15)"),
    ],
)
def test_errors_say_what_and_where(file, text, suffix, where, problem):
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_class(f"{file}{suffix}")
    assert problem in str(caught.value)
    assert f"{file}{where}" in str(caught.value)


def test_missing_file(tmp_path):
    with pytest.raises(ConfigError, match="no such file"):
        load_class(str(tmp_path / "none.py"))
