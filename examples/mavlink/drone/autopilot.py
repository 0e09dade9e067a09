"""The autopilot: answers whoever is on the link, and says what it does. `python -m drone.autopilot --help`."""

from __future__ import annotations

import argparse
import signal
import sys
from time import monotonic

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drone.commands import ACCEPTED, DENIED, HIGHEST, UNSUPPORTED, carry_out, go_to, select, set_mode
from drone.compass import Calibration
from drone.link import Link
from drone.mission import DEGREES, Missions
from drone.parameters import Parameters
from drone.route import ROUTE, route_item
from drone.telemetry import GROUND, REPORTS, STREAMS
from drone.vehicle import Mode, Place, Vehicle

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator

    from pymavlink.dialects.v20.ardupilotmega import MAVLink_message as Message

SYSTEM, COMPONENT = 1, mavlink.MAV_COMP_ID_AUTOPILOT1
STEP, PAUSE = 0.02, 2.0
GUIDED_POINT = 2
ABSOLUTE = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
FTP_REFUSED, FTP_UNKNOWN_COMMAND = 129, 7
PLACES = (mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_LAND)


class Autopilot:
    """A drone and all that it answers; no I/O and no clock of its own.

    Args:
        seed: Seed of its noise.
        fly: Whether it has a route from the beginning and flies it by itself, again and again.
    """

    def __init__(self, seed: int, *, fly: bool = False) -> None:
        self.vehicle = Vehicle(seed)
        self.parameters = Parameters()
        self.missions = Missions(self._changed)
        self.calibration = Calibration()
        self._due = dict.fromkeys(STREAMS, 0.0)
        self._last = self._state()
        self._fly = fly
        if fly:
            self.missions.items[0] = [route_item(number, SYSTEM, COMPONENT) for number in range(len(ROUTE))]
            self._changed(0)

    def tick(self) -> Iterator[Message]:
        """Let one step of time pass; yield what is sent by itself."""
        self.vehicle.step(STEP)
        now = self.vehicle.time
        if self._fly and now > PAUSE and not self.vehicle.armed:
            self.vehicle.armed = True
            self.vehicle.current = 0
            self.vehicle.enter(Mode.AUTO)
        for stream, rate in STREAMS.items():
            if now >= self._due[stream]:
                self._due[stream] += 1 / rate
                yield stream(self.vehicle)
        yield from self.missions.tick(now)
        yield from self.calibration.tick(now)
        yield from self._news()

    def answer(self, message: Message) -> Iterator[Message]:
        """Answer a message, if it is for us and there is something to say."""
        if getattr(message, "target_system", SYSTEM) not in (0, SYSTEM):
            return
        name = message.get_type()
        if name.startswith("PARAM_"):
            yield from self.parameters.answer(message)
        elif name == "MISSION_ITEM" and message.current == GUIDED_POINT:
            done = go_to(self.vehicle, message.x, message.y, message.z) == ACCEPTED
            result = mavlink.MAV_MISSION_ACCEPTED if done else mavlink.MAV_MISSION_DENIED
            yield mavlink.MAVLink_mission_ack_message(message.get_srcSystem(), message.get_srcComponent(), result, 0)
        elif name == "MISSION_SET_CURRENT":
            select(self.vehicle, message.seq)
            yield mavlink.MAVLink_mission_current_message(self.vehicle.current, len(self.vehicle.route), 0, 0)
        elif name.startswith("MISSION_") and hasattr(message, "mission_type"):
            if name != "MISSION_ACK":
                yield from self.missions.answer(message, self.vehicle.time)
        elif name in ("COMMAND_LONG", "COMMAND_INT"):
            yield from self._obey(message)
        elif name == "SET_MODE":
            set_mode(self.vehicle, message.custom_mode)
        elif name == "FILE_TRANSFER_PROTOCOL":
            yield _no_files(message)
        elif name == "TIMESYNC" and message.tc1 == 0:
            yield mavlink.MAVLink_timesync_message(int(self.vehicle.time * 1e9) or 1, message.ts1)
        yield from self._news()

    def _obey(self, command: Message) -> Iterator[Message]:
        wanted = None
        if command.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            wanted = command.param1
            result = ACCEPTED if wanted in REPORTS else UNSUPPORTED
        elif command.command == mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            wanted, result = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, ACCEPTED
        elif command.command == mavlink.MAV_CMD_GET_HOME_POSITION:
            wanted, result = mavlink.MAVLINK_MSG_ID_HOME_POSITION, ACCEPTED
        elif command.command == mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
            result = ACCEPTED if command.param1 in REPORTS else DENIED
            if result == ACCEPTED:
                rate = STREAMS.get(REPORTS[int(command.param1)], 0)
                microseconds = round(1e6 / rate) if rate else -1
                yield mavlink.MAVLink_message_interval_message(int(command.param1), microseconds)
        elif command.command == mavlink.MAV_CMD_DO_START_MAG_CAL:
            self.calibration.start(self.vehicle.time)
            result = ACCEPTED
        elif command.command in (mavlink.MAV_CMD_DO_CANCEL_MAG_CAL, mavlink.MAV_CMD_DO_ACCEPT_MAG_CAL):
            self.calibration.cancel()
            result = ACCEPTED
        elif command.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            result = ACCEPTED if command.param1 in REPORTS else DENIED  # rates are fixed
        else:
            result = carry_out(self.vehicle, command)
        yield mavlink.MAVLink_command_ack_message(
            command.command, result, 0, 0, command.get_srcSystem(), command.get_srcComponent()
        )
        if result == ACCEPTED and wanted is not None:
            yield REPORTS[wanted](self.vehicle)

    def _changed(self, kind: int) -> None:
        if kind != mavlink.MAV_MISSION_TYPE_MISSION:
            return
        self.vehicle.route = list(map(_place, self.missions.items[kind]))
        self.vehicle.current = 0

    def _state(self) -> tuple[Mode, bool]:
        return self.vehicle.mode, self.vehicle.armed

    def _news(self) -> Iterator[Message]:
        state, vehicle = self._state(), self.vehicle
        if state != self._last:
            mode, armed = self._last
            self._last = state
            if vehicle.mode is not mode:
                yield _text(f"Mode {vehicle.mode.name}")
            if vehicle.armed is not armed:
                yield _text("Arming motors" if vehicle.armed else "Disarming motors")
            yield REPORTS[mavlink.MAVLINK_MSG_ID_HEARTBEAT](vehicle)
        if vehicle.reached is not None:
            yield mavlink.MAVLink_mission_item_reached_message(vehicle.reached)
            yield _text(f"Reached command #{vehicle.reached}")
            vehicle.reached = None


def _place(item: Message) -> Place | Mode | None:
    """Return where an item of a mission is, or what it does, None if neither; the first is home, and not flown to."""
    if item.seq and item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
        return Mode.RTL
    if item.seq == 0 or item.command not in PLACES or not (item.x or item.y):
        return None
    above = item.z - GROUND if item.frame in ABSOLUTE else item.z
    return Place(item.x / DEGREES, item.y / DEGREES, max(0.0, min(HIGHEST, above)))


def _no_files(request: Message) -> Message:
    """Refuse a request for a file: there are none."""
    sequence, session, operation = request.payload[0] | request.payload[1] << 8, request.payload[2], request.payload[3]
    answer = [*((sequence + 1) % 65536).to_bytes(2, "little"), session, FTP_REFUSED, 1, operation, 0, 0, 0, 0, 0, 0]
    payload = [*answer, FTP_UNKNOWN_COMMAND] + [0] * (251 - len(answer) - 1)
    return mavlink.MAVLink_file_transfer_protocol_message(
        0, request.get_srcSystem(), request.get_srcComponent(), payload
    )


def _text(text: str) -> Message:
    return mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_INFO, text.encode(), 0, 0)


def run(link: Link, autopilot: Autopilot, *, speed: float, duration: float, wait: float) -> None:
    """Fly.

    Args:
        link: Connection to the ground.
        autopilot: The drone that flies.
        speed: How many times faster than real time.
        duration: Seconds of its own time after which it ends, 0 for none; they count from the first message that it
            gets, or from `wait` seconds after the start.
        wait: See there.
    """
    start = monotonic()
    begun = None if duration else 0.0
    steps = 0
    while begun is None or not duration or autopilot.vehicle.time - begun < duration:
        due = start + steps * STEP / speed
        if monotonic() >= due:
            steps += 1
            for message in autopilot.tick():
                link.send(message)
            if begun is None and (link.received or monotonic() - start > wait):
                begun = autopilot.vehicle.time
            continue
        for message in link.receive(due):
            for answer in autopilot.answer(message):
                link.send(answer)


def main() -> None:
    """Run as a process; at the end it says what was lost on the way to it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connect", default="udpout:127.0.0.1:14550", help="udpin:, udpout:, tcp: or tcpin:HOST:PORT")
    parser.add_argument("--fly", action="store_true", help="fly a route without being told to")
    parser.add_argument("--speed", type=float, default=1.0, help="how many times faster than real time")
    parser.add_argument("--seed", type=int, default=1, help="of its noise")
    parser.add_argument("--duration", type=float, default=0.0, help="seconds until the end, 0 for none")
    parser.add_argument("--wait", type=float, default=10.0, help="seconds to wait for somebody on the ground")
    options = parser.parse_args()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    with Link(options.connect, system=SYSTEM, component=COMPONENT) as link:
        try:
            run(
                link,
                Autopilot(options.seed, fly=options.fly),
                speed=options.speed,
                duration=options.duration,
                wait=options.wait,
            )
        finally:
            for (system, component), received in sorted(link.received.items()):
                lost = link.lost[system, component]
                print(f"from {system}/{component}: {received} received, {lost} lost", flush=True)


if __name__ == "__main__":
    main()
