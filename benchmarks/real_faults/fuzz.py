"""Atheris on a case, in the case's own environment: `fuzz.py CASE SECONDS SEED FILE KNOWN`; nominal inputs on stdin.

Coverage guides which fields of which messages get which values. The node runs in this process, all logs one after the
other. Each line on stdout is a log that made it raise at a place that is not KNOWN (a JSON list) yet; FILE has the last
log, for when it hangs or is killed.
"""

from __future__ import annotations

import copy
import json
import os
import struct
import sys
from typing import Any

import atheris


def leaves(value: Any, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the places of all scalars in a JSON value."""
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        return [each for key, one in items for each in leaves(one, (*place, key))]
    return [] if value is None else [place]


def drawn(data: Any, before: Any) -> Any:
    """Return a value of the type of another one."""
    if isinstance(before, bool):
        return data.ConsumeBool()
    if isinstance(before, int):
        return data.ConsumeInt(8)
    if isinstance(before, float):
        raw = data.ConsumeBytes(8)
        return struct.unpack("<d", raw)[0] if len(raw) == 8 else data.ConsumeRegularFloat()
    return data.ConsumeUnicodeNoSurrogates(40)


def main() -> None:
    """Fuzz until the time is over."""
    case, seconds, seed, known = sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), set(json.loads(sys.argv[5]))
    last = os.open(sys.argv[4], os.O_WRONLY | os.O_CREAT)
    nominal = json.loads(sys.stdin.read())
    sys.path.insert(0, case)
    with atheris.instrument_imports():
        import node
    refused, checked = getattr(node, "REFUSED", ()), False
    answers = os.dup(1)
    os.dup2(2, 1)
    places = [(number, place) for number, (_, _, fields) in enumerate(nominal) for place in leaves(fields)]

    def one(raw: bytes) -> None:
        data = atheris.FuzzedDataProvider(raw)
        log = [list(each) for each in nominal]
        for _ in range(data.ConsumeIntInRange(1, 3)):
            number, place = data.PickValueInList(places)
            log[number][2] = fields = copy.deepcopy(log[number][2])
            for key in place[:-1]:
                fields = fields[key]
            fields[place[-1]] = drawn(data, fields[place[-1]])
        text = json.dumps(log).encode()
        os.pwrite(last, text, 0)
        os.ftruncate(last, len(text))
        handlers = node.node(lambda topic, fields: None, checked)
        for _, topic, fields in log:
            try:
                handlers[topic](fields)
            except refused:
                pass
            except Exception as error:
                trace = error.__traceback__
                while trace is not None and trace.tb_next is not None:
                    trace = trace.tb_next
                where = "" if trace is None else f"{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}"
                name = f"raised {type(error).__name__} {where}"
                if name not in known:
                    known.add(name)
                    os.write(answers, json.dumps([name, log]).encode() + b"\n")
                return

    limits = [f"-max_total_time={int(seconds)}", "-timeout=5", "-len_control=0", "-max_len=256", "-print_final_stats=1"]
    atheris.Setup([sys.argv[0], f"-seed={seed}", *limits], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
