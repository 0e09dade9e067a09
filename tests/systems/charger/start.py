"""Runs a node in a DDS domain of its own and a bridge from there to a segment.

Usage: `start.py ENDPOINT FOLDER NODE [ARGUMENT...]`. Ends as the node ends; whoever starts this kills the whole process
group, so nothing is left behind.
"""

import os
import signal
import subprocess
import sys
import time

from riot_bus.sut.domains import free_domains

PYTHON = os.environ["RIOT_ROS_PYTHON"]
FOREIGN = ("ROS_", "RMW_", "FASTDDS_", "AMENT_", "ZENOH_", "PYTHON", "RIOT_")


def main(endpoint, folder, script, *arguments):
    with free_domains(1) as (domain,):
        run(domain, endpoint, folder, script, *arguments)


def run(domain, endpoint, folder, script, *arguments):
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
