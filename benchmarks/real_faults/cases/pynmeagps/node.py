"""Tells fixes to older instruments, in NMEA 0183, and how many degrees they would be off by."""

from datetime import time

from pynmeagps import GET, NMEAMessage, NMEAReader

QUALITY = {"single": 1, "dgps": 2, "fixed": 4, "float": 5}


def node(publish, checked):
    def fix(m):
        lat, lon, clock = m["lat"], m["lon"], m["clock"]
        if m["mode"] not in QUALITY or not (abs(lat) <= 90 and abs(lon) <= 180 and 0 <= clock < 86400):
            return
        hours, seconds = divmod(int(clock), 3600)
        fields = {"time": time(hours, *divmod(seconds, 60)), "lat": lat, "lon": lon, "quality": QUALITY[m["mode"]]}
        others = {"numSV": 12, "HDOP": 0.8, "alt": 0.0, "altUnit": "M", "sep": 0.0, "sepUnit": "M"}
        line = NMEAMessage("GN", "GGA", GET, **fields, **others).serialize()
        told = NMEAReader.parse(line)
        off = max(abs(told.lat - lat), abs(told.lon - lon))
        publish("nmea", {"line": line.decode().strip(), "off": off})

    return {"fix": fix}
