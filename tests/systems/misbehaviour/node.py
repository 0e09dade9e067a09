"""A node with one way to misbehave: `node.py KIND ENDPOINT`. It answers `cmd` with `state` until a bad one comes.

A bad command has an `x` that is no number, not finite, or out of all proportion. Robust kinds stand at the end. Native
kinds call `faults.so`, built from `faults.c`; measured ones publish on `measured`, which monitors of riot.toml look at.
"""

import ctypes
import json
import math
import os
import queue
import subprocess
import sys
import threading
import time
import zlib

import zenoh

KIND, ENDPOINT = sys.argv[1:3]
THREADED = ("lost_worker", "restarts_thread", "stdout_traceback")
MEASURED = ("answers_twice", "keeps_messages", "not_finite", "stale_stamp")
FAULTS = {  # for a large x, and for others
    "faults_in_c": ("read_row", "write_row"),
    "faults_in_libc": ("clear_large", "clear_not_finite"),
    "overruns": ("read_past", "read_past"),
}
PLACES = 6
LAST_WORD = 45  # in the nominal log after the probe, wherever in a log of 30 commands the bad one was

inbox = queue.Queue()
first, second = threading.Lock(), threading.Lock()
seen_bad = muted = homed = told = False
count = refused = 0
total = 0.0
mode = 0
kept = []


def is_bad(x):
    return isinstance(x, bool) or not isinstance(x, (int, float)) or not math.isfinite(x) or abs(x) > 1e6


def take_first():
    with first:
        time.sleep(0.01)
        with second:
            pass


def take_second():
    with second:
        time.sleep(0.01)
        with first:
            pass


def leave():
    sys.exit(3)


def wait_for_ever():
    while True:
        time.sleep(0.01)


def spin():
    while True:
        pass


def poke_not_finite():
    ctypes.memset(8, 0, 4)


def poke_large():
    ctypes.memset(16, 0, 4)


def misbehave(command):
    """What a bad command brings; True if it is not to be answered."""
    if KIND == "sys_exit":
        leave()
    elif KIND == "exit_zero":
        os._exit(0)
    elif KIND == "exit_status":
        os._exit(4)
    elif KIND == "raises":
        raise ValueError("bad")
    elif KIND == "deadlock":
        threading.Thread(target=take_second).start()
        take_first()
    elif KIND == "livelock":
        wait_for_ever()
    elif KIND == "busy":
        spin()
    elif KIND == "sometimes" and os.urandom(1)[0] < 77:
        raise ValueError("three times of ten")
    elif KIND == "stdout_traceback":
        import traceback

        try:
            raise ValueError("bad")
        except ValueError:
            print(traceback.format_exc(), flush=True)
            raise SystemExit from None
    elif KIND == "leaks_much" and not kept:
        kept.append(b"\1" * (500 << 20))
    elif KIND == "takes_all_memory":
        while True:
            kept.append(b"\1" * (64 << 20))
    elif KIND == "opens_all_files":
        while True:
            kept.append(os.open(os.devnull, os.O_RDONLY))
            time.sleep(1e-4)
    elif KIND == "starts_processes":
        while True:
            kept.append(subprocess.Popen(["sleep", "60"]))
    elif KIND == "runs_for_long":
        spin()
    elif KIND == "twenty_faults":
        fault, place = divmod(zlib.crc32(repr(command.get("x")).encode()) % 20, PLACES)
        getattr(ctypes.CDLL("./faults.so"), f"place_{place}")(fault)
    elif KIND == "segfaults" or KIND in FAULTS:
        x = command.get("x")
        large = isinstance(x, (int, float)) and math.isfinite(x)
        if KIND in FAULTS:
            getattr(ctypes.CDLL("./faults.so"), FAULTS[KIND][not large])(8)
        poke_large() if large else poke_not_finite()
    elif KIND == "ignores":
        print("ERROR: bad input", file=sys.stderr)
    elif KIND == "refuses":
        print("refused a bad command", file=sys.stderr)
        return True
    return KIND == "ignores"


def handle(command):
    global seen_bad, count
    bad = is_bad(command.get("x"))
    seen_bad |= bad
    if KIND == "order_of_two" and mode == 1 and bad:
        raise ValueError("bad while the mode is 1")
    count += KIND not in MEASURED
    if KIND == "homes" and not is_homed(command, bad):
        return
    if bad and misbehave(command):
        return
    if KIND in ("ignores", "silent") and seen_bad:
        return
    if KIND == "last_words" and seen_bad:
        kept.append(command)
        if len(kept) != LAST_WORD:
            return
    if KIND == "leaks_slowly" and seen_bad:
        kept.append(b"\1" * (2 << 20))
    if KIND == "leaks_little" and seen_bad:
        kept.append(b"\1" * (60 << 10))
    if KIND == "caches" and bad:
        kept[:] = [b"\1" * (8 << 20)]
    if KIND == "records":
        kept.append(b"\1" * (200 << 10))
    if KIND == "keeps_messages" and seen_bad:
        kept.append(command)
    if KIND == "leaks_files" and seen_bad:
        kept.extend(os.open(os.devnull, os.O_RDONLY) for _ in range(3))
    if KIND == "slow":
        time.sleep(0.02)
    if KIND == "chatty":
        print(f"no error, no exception: message {count}", file=sys.stderr, flush=True)
    if KIND != "silent_by_design":
        measure(command, bad) if KIND in MEASURED else answer(command, bad)


def is_homed(command, bad):
    """Home by the log's first command, told once; a bad one asks for that again, which the probe does not bring."""
    global homed, told
    homed = not bad and (homed or command["x"] == 0)
    if homed and not told:
        session.put("homed", "{}")
        told = True
    return homed


def measure(command, bad):
    global count
    y = command["x"] if not bad else math.nan if KIND == "not_finite" else 0.0
    for _ in range(1 + (KIND == "answers_twice" and seen_bad)):
        count += not (KIND == "stale_stamp" and seen_bad)
        out.put(json.dumps({"y": y, "n": count, "kept": len(kept)}))


def answer(command, bad):
    global refused, total
    y = 0.0 if bad else command["x"]
    refused += bad
    total = max(-1e3, min(1e3, total + (1e6 if bad else y)))
    y = {"echoes": command.get("x"), "sums": total}.get(KIND, y)
    state = {"y": y, "n": count, "t": time.time(), "refused": refused}
    times = 1
    if seen_bad:
        wrong = {"not_a_number": math.nan, "wrong_scale": 0.9 * y if KIND == "wrong_scale" else y, "frozen": 3.5}
        state["y"] = math.nan if KIND == "not_a_number_once" and bad else wrong.get(KIND, y)
        state["t"] -= 60 if KIND == "stale" else 0
        state["n"] = 7 if KIND == "stuck_counter" else count
        times = {"twice": 2, "halves": count % 2}.get(KIND, 1)
    for _ in range(times):
        out.put(json.dumps(state))


def main():
    while True:
        handle(inbox.get())


def worker():
    while True:
        command = inbox.get()
        if is_bad(command.get("x")) and KIND == "lost_worker":
            return
        if is_bad(command.get("x")) and KIND == "restarts_thread":
            threading.Thread(target=worker).start()
            return
        handle(command)


def tick():
    ticks = session.declare_publisher("tick")
    while True:
        time.sleep(0.02)
        ticks.put("{}")


def document(sample):
    try:
        return json.loads(sample.payload.to_bytes())
    except ValueError:
        return {}


def on_mode(sample):
    global muted, mode
    mode = document(sample).get("m")
    muted = KIND == "muted_by_mode" and mode == 1


def on_command(sample):
    global count
    command = document(sample)
    if "reset" in command:
        count = 0
    elif KIND == "order_of_two":
        handle(command)
    elif not muted:
        inbox.put(command)


config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
session = zenoh.open(config)
out = session.declare_publisher(
    "measured" if KIND in MEASURED else "state", congestion_control=zenoh.CongestionControl.BLOCK
)
if KIND == "timers":
    threading.Thread(target=tick, daemon=True).start()
modes = session.declare_subscriber("mode", on_mode)
commands = session.declare_subscriber("cmd", on_command)
if KIND in THREADED:
    threading.Thread(target=worker).start()
    threading.Event().wait()
main()
