"""Command-line options, all of the form `--name value`."""

from __future__ import annotations

import sys
from math import isfinite

CONNECT = ("connect",)
PACED = ("connect", "speed", "seed", "duration", "wait")

MEANING = {
    "connect": "Zenoh endpoint of the router",
    "speed": "how many times faster than real time",
    "seed": "seed of everything random",
    "duration": "simulated seconds until the end, 0 for none",
    "wait": "seconds to wait for a first subscriber",
}


class Options:
    """Values of all options, as given or by default."""

    def __init__(self) -> None:
        self.connect = "tcp/127.0.0.1:7447"
        self.speed = 1.0
        self.seed = 1
        self.duration = 0.0
        self.wait = 5.0


def parse(names: tuple[str, ...]) -> Options:
    """Read the command line; on a mistake, say what is wrong and exit with status 2."""
    options = Options()
    words = sys.argv[1:]
    if "--help" in words or "-h" in words:
        print("options:")
        for name in names:
            print(f"  --{name} {name.upper()}  {MEANING[name]} (default: {getattr(options, name)})")
        raise SystemExit(0)
    while words:
        word = words.pop(0)
        name, equals, text = word.removeprefix("--").partition("=")
        if not word.startswith("--") or name not in names:
            fail(f"unknown option {word!r}; there are: {', '.join('--' + known for known in names)}")
        if not equals:
            if not words:
                fail(f"option --{name} needs a value")
            text = words.pop(0)
        setattr(options, name, convert(name, text, getattr(options, name)))
    return options


def convert(name: str, text: str, default: object) -> str | int | float:
    """Read one option's value as the type of its default."""
    if isinstance(default, str):
        return text
    try:
        value = int(text) if isinstance(default, int) else float(text)
    except ValueError:
        fail(f"option --{name}: {text!r} is not a number")
    if not isfinite(value) or (name != "seed" and value < 0) or (name == "speed" and value == 0):
        fail(f"option --{name}: {text} is out of range")
    return value


def fail(problem: str) -> Never:
    """Say what is wrong with the command line and leave."""
    print(f"{sys.argv[0]}: {problem}", file=sys.stderr)
    raise SystemExit(2)


TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Never
