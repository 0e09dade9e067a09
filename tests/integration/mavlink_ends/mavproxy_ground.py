"""An unmodified MAVProxy, driven by its command line, run in an environment that has it: `mavproxy_ground.py URL`.

Prints what MAVProxy has said as one JSON object.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

PATIENCE = 25.0
ROUTE = """QGC WPL 110
0 1 0 16 0 0 0 0 47.397742 8.545594 488 1
1 0 3 22 0 0 0 0 47.397742 8.545594 20 1
2 0 3 16 0 0 0 0 47.398242 8.545594 25 1
"""


class MavProxy:
    def __init__(self, url, folder):
        program = Path(sys.executable).with_name("mavproxy.py")
        environment = {**os.environ, "HOME": str(folder), "PYTHONUNBUFFERED": "1"}
        command = [sys.executable, str(program), f"--master={url}", "--moddebug=4", f"--state-basedir={folder}"]
        self.process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.text = ""
        self.used = 0
        self.news = threading.Condition()
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        for line in self.process.stdout:
            with self.news:
                self.text += line
                self.news.notify()

    def say(self, command):
        self.process.stdin.write(f"{command}\n")
        self.process.stdin.flush()

    def hear(self, pattern):
        """Wait until it says this, after what was heard before; return the match."""
        deadline = time.monotonic() + PATIENCE
        with self.news:
            while not (match := re.compile(pattern).search(self.text, self.used)):
                if not self.news.wait(max(0.0, deadline - time.monotonic())) and time.monotonic() > deadline:
                    raise SystemExit(f"no {pattern!r} in:\n{self.text[self.used :]}")
            self.used = match.end()
        return match

    def ask(self, command, pattern):
        self.say(command)
        return self.hear(pattern)

    def end(self):
        self.process.stdin.close()
        self.process.wait(PATIENCE)
        self.reader.join(PATIENCE)


def main(url, folder):
    (folder / "route.txt").write_text(ROUTE.replace(" ", "\t").replace("QGC\tWPL\t", "QGC WPL "))
    proxy = MavProxy(url, folder)
    report = {"system": proxy.hear(r"online system (\d+)")[1]}
    report["parameters"] = proxy.hear(r"Received (\d+) parameters")[1]
    proxy.say("param set RTL_ALT 2000")
    report["set"] = until_number(proxy, "param show RTL_ALT", r"RTL_ALT\s+(\S+)", lambda value: value == 2000)
    proxy.ask("wp load route.txt", r"Got MISSION_ACK: TYPE_MISSION: ACCEPTED")
    proxy.ask("wp list", r"Requesting (\d+) waypoints")
    rows = [proxy.hear(r"(?m)^(\d+) (\d+) (-?[\d.]+) (-?[\d.]+) (-?[\d.]+) p1").groups() for _ in range(3)]
    report["mission"] = [[int(each[0]), int(each[1]), *map(float, each[2:])] for each in rows]
    proxy.ask("mode GUIDED", r"Mode GUIDED")
    proxy.ask("arm throttle", r"Got COMMAND_ACK: COMPONENT_ARM_DISARM: ACCEPTED")
    proxy.hear("ARMED")
    proxy.ask("takeoff 5", r"Got COMMAND_ACK: NAV_TAKEOFF: ACCEPTED")
    report["climbs"] = until_number(proxy, "status VFR_HUD", r"VFR_HUD \{.*climb : (-?[\d.]+)", lambda climb: climb > 1)
    proxy.ask("mode LAND", r"Mode LAND")
    report["lost"] = proxy.ask("link", r"\((\d+) packets.* (\d+) lost")[2]
    # Its threads may raise while it ends: it closes their queues and links before it has joined them.
    report["tracebacks"] = [part[:2000] for part in proxy.text.split("Traceback")[1:]]
    proxy.end()
    print(json.dumps(report), flush=True)


def until_number(proxy, command, pattern, wanted):
    deadline = time.monotonic() + PATIENCE
    while not wanted(float(proxy.ask(command, pattern)[1])):
        if time.monotonic() > deadline:
            raise SystemExit(f"{command}: waited in vain")
        time.sleep(0.1)
    return True


with tempfile.TemporaryDirectory() as name:
    main(sys.argv[1], Path(name))
