"""Packs every four samples of telemetry into one frame, as for a radio, and reads it back in pieces of 16 bytes."""

import msgpack


def node(publish, checked):
    samples = []
    radio = msgpack.Unpacker(max_buffer_size=1 << 16)

    def telemetry(m):
        if not (0 <= m["seq"] < 1 << 32 and -100 <= m["temp"] <= 200 and 1 <= len(m["cells"]) <= 16):
            return
        if not all(0 <= each <= 10 for each in m["cells"]):
            return
        note = m["note"][:80].encode(errors="replace").decode()
        samples.append({"seq": m["seq"], "temp": m["temp"], "cells": m["cells"], "note": note})
        if len(samples) < 4:
            return
        packed = msgpack.packb(samples)
        samples.clear()
        for begin in range(0, len(packed), 16):
            radio.feed(packed[begin : begin + 16])
            for frame in radio:
                cells = [each for sample in frame for each in sample["cells"]]
                notes = [sample["note"] for sample in frame if sample["note"]]
                mean = sum(cells) / len(cells)
                publish("frame", {"size": len(packed), "first": frame[0]["seq"], "cell": mean, "notes": notes})

    return {"telemetry": telemetry}
