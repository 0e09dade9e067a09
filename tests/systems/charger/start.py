"""Runs a node in a DDS domain of its own and a bridge from there to a segment.

Usage: `start.py ENDPOINT FOLDER NODE [ARGUMENT...]`. Ends as the node ends; whoever starts this kills the whole process
group, so nothing is left behind.
"""

import fcntl
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PYTHON = os.environ["RIOT_ROS_PYTHON"]
FIRST_DOMAIN, LAST_DOMAIN = 1, 99
FOREIGN = ("ROS_", "RMW_", "FASTDDS_", "AMENT_", "ZENOH_", "PYTHON", "RIOT_")


def reserve_domain():
    """Return a domain that nobody else on this machine reserves while the returned lock is open."""
    folder = Path(tempfile.gettempdir()) / f"riot-bus-domains-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    numbers = list(range(FIRST_DOMAIN, LAST_DOMAIN + 1))
    random.shuffle(numbers)
    for number in numbers:
        lock = (folder / str(number)).open("w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        return number, lock
    raise SystemExit("all DDS domains are in use")


def main(endpoint, folder, script, *arguments):
    domain, _lock = reserve_domain()
    ros = {
        **{key: value for key, value in os.environ.items() if not key.startswith(FOREIGN)},
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": folder,
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    }
    options = [f"--endpoint={endpoint}", f"--domain={domain}", f"--python={PYTHON}"]
    here = {key: value for key, value in os.environ.items() if key == "PYTHONPATH"}
    bridge = subprocess.Popen(
        [sys.executable, "-m", "riot_bus", "bridge", "ros2", *options], env={**ros, **here}, stdout=subprocess.DEVNULL
    )
    node = subprocess.Popen([PYTHON, script, *arguments], env=ros)
    while node.poll() is None:
        if bridge.poll() is not None:
            node.kill()
            raise SystemExit(f"the bridge has ended with status {bridge.returncode}")
        time.sleep(0.05)
    bridge.send_signal(signal.SIGTERM if node.returncode == 0 else signal.SIGKILL)
    bridge.wait()
    if node.returncode < 0:
        os.kill(os.getpid(), -node.returncode)
    sys.exit(node.returncode)


if __name__ == "__main__":
    main(*sys.argv[1:])
