"""Puts packets that come out of order back into order; a thread hands on what has waited long enough."""

import threading
import time

from sortedcontainers import SortedDict

PACED = True


def node(publish, checked):
    waiting, lock, done = SortedDict(), threading.Lock(), -1

    def packet(m):
        nonlocal done
        if not (0 <= m["seq"] < 1 << 32 and -1e6 <= m["value"] <= 1e6):
            return
        with lock:
            if abs(m["seq"] - done) > 20:  # the sender has begun anew
                waiting.clear()
                done = m["seq"] - 1
            if m["seq"] > done:
                waiting.setdefault(m["seq"], (time.monotonic(), m["value"]))

    def hand_on():
        nonlocal done
        while True:
            time.sleep(0.02)
            with lock:
                while waiting and waiting.peekitem(0)[1][0] < time.monotonic() - 0.15:
                    seq, (_, value) = waiting.popitem(0)
                    publish("ordered", {"seq": seq, "value": value, "lost": max(0, seq - done - 1)})
                    done = seq

    threading.Thread(target=hand_on, daemon=True).start()
    return {"packet": packet}
