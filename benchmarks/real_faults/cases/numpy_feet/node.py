"""Tells quartiles of what the feet of a walking robot carry, from raw 16 bit counts of their converters."""

import numpy as np

NEWTONS = 0.02  # for one count


def node(publish, checked):
    bias = 0.0

    def feet(m):
        if not m["counts"] or not all(-32768 <= each <= 32767 for each in m["counts"]):
            return
        counts = np.array(m["counts"], dtype=np.int16)
        if checked:
            counts = counts.astype(float)
        low, middle, high = (np.percentile(counts, [25, 50, 75]) - bias) * NEWTONS
        publish(
            "load",
            {"low": float(low), "middle": float(middle), "high": float(high), "uneven": float(high - low) > 400.0},
        )

    def tare(m):
        nonlocal bias
        if abs(m["bias"]) <= 1000:
            bias = m["bias"]

    return {"feet": feet, "tare": tare}
