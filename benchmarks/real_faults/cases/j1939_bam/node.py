"""Reads the CAN bus of an engine: its speed, and its torque curve, which comes in several frames."""

import j1939

CONTROL, DATA = 0xEC, 0xEB  # groups of the frames that announce a long message, and of those that carry it


def node(publish, checked):
    following = {}

    def found(priority, pgn, source, timestamp, data):
        if pgn == 0xF004 and len(data) == 8:
            publish("engine", {"source": source, "rpm": (data[3] | data[4] << 8) / 8})
        elif pgn == 0xFEE3:
            pairs = [data[i] | data[i + 1] << 8 for i in range(0, len(data) - 1, 2)]
            publish("curve", {"source": source, "points": pairs})

    unit = j1939.ElectronicControlUnit(send_message=lambda *frame: None)
    unit.subscribe(found)

    def in_order(sender, group, number):
        if group not in (CONTROL, DATA):
            return True
        expected = 32 if group == CONTROL else following.pop(sender, 0)
        following[sender] = 1 if group == CONTROL else number + 1
        return number == expected or following.pop(sender) is None

    def can(m):
        if not (m["extended"] and isinstance(m["id"], int) and 0 <= m["id"] < 1 << 29):
            return
        if len(m["data"]) != 8 or not set(m["data"]) <= set(range(256)):
            return
        group, data = m["id"] >> 16 & 0x1FF, bytearray(int(byte) for byte in m["data"])
        if group == CONTROL and data[0] not in (16, 17, 19, 32, 255):
            return  # the library refuses them
        if not checked or in_order(m["id"] & 0xFFFF, group, data[0]):
            unit.notify(m["id"], data, m["stamp"])

    return {"can": can}
