"""Tells time and place from the sentences of a receiver; sentences that are no NMEA are passed over."""

import pynmea2

REFUSED = (pynmea2.ParseError,)


def node(publish, checked):
    def nmea(m):
        found = pynmea2.parse(m["line"], check=True)
        if found.sentence_type != "RMC":
            return
        if checked and not (found.datestamp and found.timestamp):
            return
        publish("place", {"lat": found.latitude, "lon": found.longitude, "time": found.datetime.timestamp()})

    return {"nmea": nmea}
