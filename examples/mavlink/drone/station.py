"""The ground station: shows how the drone is, and flies a route if it is told to. `python -m drone.station --help`."""

from __future__ import annotations

import argparse
import signal
import sys
from time import monotonic

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drone.link import Link
from drone.route import ROUTE, route_item
from drone.vehicle import Mode

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from pymavlink.dialects.v20.ardupilotmega import MAVLink_message as Message

SYSTEM, COMPONENT = 255, mavlink.MAV_COMP_ID_MISSIONPLANNER
BEAT, RETRY, SHOW = 1.0, 1.0, 1.0
TICK = 0.1
GAUGE = (
    "[          ]",
    "[#         ]",
    "[##        ]",
    "[###       ]",
    "[####      ]",
    "[#####     ]",
    "[######    ]",
    "[#######   ]",
    "[########  ]",
    "[######### ]",
    "[##########]",
)


class Station:
    """What a ground station knows and asks; no I/O and no clock of its own.

    Args:
        fly: Whether to upload the route, arm and start it.

    Attributes:
        vehicle: The autopilot's system and component, None before its first heartbeat.
        parameters: What it has told.
        count: How many parameters it has, None before the first.
        acknowledged: Results of commands, by command.
        uploaded: Whether the route was accepted.
        armed: Whether the drone is.
    """

    def __init__(self, *, fly: bool) -> None:
        self.fly = fly
        self.vehicle: tuple[int, int] | None = None
        self.parameters: dict[str, float] = {}
        self.count: int | None = None
        self.acknowledged: dict[int, int] = {}
        self.uploaded = False
        self.armed = False
        self.battery = ""
        self.height = 0.0
        self._asked = self._beat = self._shown = -RETRY

    def tick(self, now: float) -> Iterator[Message]:
        """Yield what is due: a heartbeat, and the next question that has no answer yet."""
        if now - self._beat >= BEAT:
            self._beat = now
            yield mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
        if self.vehicle is not None and now - self._asked >= RETRY:
            self._asked = now
            yield from self._ask(*self.vehicle)

    def show(self, now: float) -> str | None:
        """Return a line for the screen, if one is due."""
        if now - self._shown < SHOW or self.vehicle is None:
            return None
        self._shown = now
        return f"{self.battery or '[ no data  ]'} {self.height:6.1f} m {'armed' if self.armed else 'safe'}"

    def hear(self, message: Message, now: float) -> Iterator[Message]:
        """Take a message, and yield what it calls for."""
        handler: Callable[[Message], Iterator[Message] | None] | None
        handler = getattr(self, f"on_{message.get_type().lower()}", None)
        if handler is None or (self.vehicle is None and message.get_type() != "HEARTBEAT"):
            return
        if getattr(message, "target_system", SYSTEM) not in (0, SYSTEM):
            return
        yield from handler(message) or ()
        if message.get_type() in ("COMMAND_ACK", "MISSION_ACK") and self.vehicle is not None:
            self._asked = now
            yield from self._ask(*self.vehicle)

    # -- questions ----------------------------------------------------------------------------------------------------

    def _ask(self, system: int, component: int) -> Iterator[Message]:
        if self.count is None or len(self.parameters) < self.count:
            yield mavlink.MAVLink_param_request_list_message(system, component)
        if not self.fly:
            return
        if not self.uploaded:
            yield mavlink.MAVLink_mission_count_message(system, component, len(ROUTE), 0)
        elif not self._accepted(mavlink.MAV_CMD_COMPONENT_ARM_DISARM):
            yield self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        elif not self._accepted(mavlink.MAV_CMD_DO_SET_MODE):
            yield self._command(mavlink.MAV_CMD_DO_SET_MODE, 1, Mode.GUIDED)
        elif not self._accepted(mavlink.MAV_CMD_MISSION_START):
            yield self._command(mavlink.MAV_CMD_MISSION_START)

    def _accepted(self, command: int) -> bool:
        return bool(self.acknowledged.get(command) == mavlink.MAV_RESULT_ACCEPTED)

    def _command(self, command: int, *values: float) -> Message:
        assert self.vehicle is not None
        return mavlink.MAVLink_command_long_message(*self.vehicle, command, 0, *values, *[0.0] * (7 - len(values)))

    # -- answers ------------------------------------------------------------------------------------------------------

    def on_heartbeat(self, message: Message) -> None:
        """Learn who flies, and whether it is armed."""
        if message.type == mavlink.MAV_TYPE_GCS or message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
            return
        if self.vehicle is None:
            self.vehicle = message.get_srcSystem(), message.get_srcComponent()
        self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    def on_param_value(self, message: Message) -> None:
        """Keep a parameter."""
        self.count = message.param_count
        self.parameters[message.param_id] = message.param_value

    def on_mission_request(self, message: Message) -> Iterator[Message]:
        """Send an item of the route."""
        if message.mission_type or message.seq >= len(ROUTE) or self.vehicle is None:
            return
        yield route_item(message.seq, *self.vehicle)

    on_mission_request_int = on_mission_request

    def on_mission_ack(self, message: Message) -> None:
        """Note whether the route was taken."""
        if message.mission_type == 0:
            self.uploaded = message.type == mavlink.MAV_MISSION_ACCEPTED

    def on_command_ack(self, message: Message) -> None:
        """Note what has become of a command."""
        self.acknowledged[message.command] = message.result

    def on_sys_status(self, message: Message) -> None:
        """Draw the battery; -1 means that nobody knows how full it is."""
        left = message.battery_remaining
        self.battery = GAUGE[left // 10] if left >= 0 else ""

    def on_global_position_int(self, message: Message) -> None:
        """Note the height."""
        self.height = message.relative_alt / 1000

    def on_statustext(self, message: Message) -> None:
        """Print what is urgent at once."""
        if message.severity <= mavlink.MAV_SEVERITY_WARNING:
            print(f"! {message.text}", flush=True)


def run(link: Link, station: Station, *, duration: float) -> None:
    """Work until `duration` seconds have passed, 0 for ever."""
    start = now = monotonic()
    while not duration or now - start < duration:
        for message in station.tick(now):
            link.send(message)
        line = station.show(now)
        if line is not None:
            print(line, flush=True)
        for message in link.receive(now + TICK):
            for answer in station.hear(message, monotonic()):
                link.send(answer)
        now = monotonic()


def main() -> None:
    """Run as a process; at the end it says what it knows, and what was lost on the way to it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connect", default="udpin:127.0.0.1:14550", help="udpin:, udpout:, tcp: or tcpin:HOST:PORT")
    parser.add_argument("--fly", action="store_true", help="upload a route and fly it")
    parser.add_argument("--duration", type=float, default=0.0, help="seconds until the end, 0 for none")
    options = parser.parse_args()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    station = Station(fly=options.fly)
    with Link(options.connect, system=SYSTEM, component=COMPONENT) as link:
        try:
            run(link, station, duration=options.duration)
        finally:
            print(f"{len(station.parameters)} of {station.count} parameters; commands {station.acknowledged}")
            for (system, component), received in sorted(link.received.items()):
                lost = link.lost[system, component]
                print(f"from {system}/{component}: {received} received, {lost} lost", flush=True)


if __name__ == "__main__":
    main()
