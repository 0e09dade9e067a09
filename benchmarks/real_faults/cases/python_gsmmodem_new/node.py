"""Turns a robot's alarms into commands for a modem, which sends them as text messages to who is on duty."""

from gsmmodem.pdu import encodeSmsSubmitPdu

NUMBER = "+4915112345678"
LONGEST = 280


def node(publish, checked):
    sent = 0

    def alarm(m):
        nonlocal sent
        if not m["level"] >= 2:
            return
        text = " ".join(f"⚠ {m['robot']}: {m['text']} ({m['battery']} V)".split())[:LONGEST]
        if checked:
            text = "".join(each if ord(each) <= 0xFFFF else "?" for each in text)
        for pdu in encodeSmsSubmitPdu(NUMBER, text, reference=sent % 256, requestStatusReport=False):
            publish("modem", {"command": f"AT+CMGS={pdu.tpduLength}", "pdu": str(pdu)})
        sent += 1

    return {"alarm": alarm}
