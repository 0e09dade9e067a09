"""Decodes the pages of a motor controller's status frame, with the database that comes with the controller."""

import io

import canmatrix.formats

SIGNALS = {
    0x01: {"Speed": "signed 8,16", "Torque": "signed 24,16"},
    0x02: {"Voltage": "unsigned 8,16", "Current": "signed 24,16"},
    0x03: {"Winding": "signed 8,8", "Housing": "signed 16,8"},
    0x80: {"Firmware": "unsigned 8,32"},
    0xF0: {"Reduced": "unsigned 8,8", "Limit": "signed 16,16"},
    0xFF: {"Fault": "unsigned 8,16", "Count": "unsigned 24,8"},
}
HEAD = 'FormatVersion=5.0\nTitle="Drive"\n\n{SENDRECEIVE}\n'


def database():
    text, first = HEAD, "ID=181h\n"
    for page, signals in SIGNALS.items():
        text += f"\n[Status]\n{first}DLC=8\nMux=Page{page} 0,8 {page:02X}h\n"
        text += "".join(f"Var={name} {place}\n" for name, place in signals.items())
        first = ""
    return canmatrix.formats.load(io.BytesIO(text.encode()), "sym", flatImport=True)[""]


def node(publish, checked):
    status = database().frame_by_name("Status")

    def can(m):
        try:
            data = bytes(m["data"])
        except (TypeError, ValueError):
            return
        if m["id"] == status.arbitration_id.id and len(data) == 8 and data[0] in SIGNALS:
            values = status.decode(data)
            publish("drive", {name: int(values[name].raw_value) for name in SIGNALS[data[0]]})

    return {"can": can}
