"""The process of one end, driven by JSON lines: `python -m riot_bus_conformance.child NAME END LIFE CONFIG`."""

from __future__ import annotations

import json
import os
import sys
import threading
import traceback
from typing import TYPE_CHECKING, Any

from riot_bus_conformance.scenario import find

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus_conformance.end import EndName


def main(arguments: Sequence[str]) -> None:
    """Run one end and tell the parent what it saw."""
    name, which, life, config = arguments
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print must not be taken for our messages
    lock = threading.Lock()

    def say(word: dict[str, Any]) -> None:
        with lock:
            channel.write(json.dumps(word) + "\n")
            channel.flush()

    scenario = find(name)
    side: EndName = "left" if which == "left" else "right"
    end = scenario.ends(side, scenario.prefix, json.loads(config), life=int(life), lines=sys.stdin, say=say)
    try:
        word = {"done": getattr(end, side)()}
    except BaseException:
        word = {"error": traceback.format_exc()}
    say(word)
    end.wait("!leave", 60.0)  # keep the declarations until both ends are done
    end.close()
    os._exit(0)  # Zenoh handlers that are still alive would keep the interpreter from ending


if __name__ == "__main__":
    main(sys.argv[1:])
