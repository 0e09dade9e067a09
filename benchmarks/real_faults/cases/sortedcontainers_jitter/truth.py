"""A control: there is no fault to trigger."""

import math


def nominal():
    for i in range(100):
        seq = 500 + i + (1 if i % 5 == 2 else -1 if i % 5 == 3 else 0)  # two of five change places
        yield i * 0.04, "packet", {"seq": seq, "value": round(20 * math.sin(seq / 10), 3), "rssi": -60 - i % 13}
