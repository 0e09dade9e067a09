"""Missions, fences and rally points: uploaded and downloaded item by item, as ArduPilot does."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from pymavlink.dialects.v20.ardupilotmega import MAVLink_message as Message

ACCEPTED = mavlink.MAV_MISSION_ACCEPTED
MISSION = mavlink.MAV_MISSION_TYPE_MISSION
MOST = 500
RETRY, TRIES = 1.0, 5
DEGREES = 1e7


class Upload:
    """Items that are coming in from one ground station."""

    def __init__(self, system: int, component: int, count: int, now: float) -> None:
        self.source = system, component
        self.count = count
        self.items: list[Message] = []
        self.asked, self.tries = now, 1


class Missions:
    """One list of items for each type of mission.

    Args:
        changed: Told the type of what has been uploaded or cleared.

    Attributes:
        items: By type of mission, as `MISSION_ITEM_INT`.
    """

    def __init__(self, changed: Callable[[int], None] = lambda kind: None) -> None:
        self.items: dict[int, list[Message]] = {0: [], 1: [], 2: []}
        self._changed = changed
        self._uploads: dict[int, Upload] = {}

    def answer(self, message: Message, now: float) -> Iterator[Message]:
        """Answer a message of the mission protocol."""
        name, kind = message.get_type(), message.mission_type
        system, component = message.get_srcSystem(), message.get_srcComponent()
        if kind not in self.items:
            yield _ack(system, component, mavlink.MAV_MISSION_UNSUPPORTED, kind)
        elif name == "MISSION_REQUEST_LIST":
            yield mavlink.MAVLink_mission_count_message(system, component, len(self.items[kind]), kind)
        elif name in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
            yield self._item(message, system, component)
        elif name == "MISSION_CLEAR_ALL":
            self.items[kind] = []
            self._changed(kind)
            yield _ack(system, component, ACCEPTED, kind)
        elif name == "MISSION_COUNT":
            yield from self._begin(message, now)
        elif name in ("MISSION_ITEM", "MISSION_ITEM_INT"):
            yield from self._take(message, now)

    def tick(self, now: float) -> Iterator[Message]:
        """Ask again for items that have not come, and give up in the end."""
        for kind, upload in list(self._uploads.items()):
            if now - upload.asked < RETRY:
                continue
            if upload.tries >= TRIES:
                del self._uploads[kind]
                yield _ack(*upload.source, mavlink.MAV_MISSION_OPERATION_CANCELLED, kind)
                continue
            upload.asked, upload.tries = now, upload.tries + 1
            yield _request(upload, kind)

    def _item(self, request: Message, system: int, component: int) -> Message:
        kind, number = request.mission_type, request.seq
        if number >= len(self.items[kind]):
            return _ack(system, component, mavlink.MAV_MISSION_INVALID_SEQUENCE, kind)
        item = self.items[kind][number]
        fields = [item.frame, item.command, item.current, 1, item.param1, item.param2, item.param3, item.param4]
        if request.get_type() == "MISSION_REQUEST_INT":
            return mavlink.MAVLink_mission_item_int_message(
                system, component, number, *fields, item.x, item.y, item.z, kind
            )
        x, y = item.x / DEGREES, item.y / DEGREES
        return mavlink.MAVLink_mission_item_message(system, component, number, *fields, x, y, item.z, kind)

    def _begin(self, message: Message, now: float) -> Iterator[Message]:
        kind, system, component = message.mission_type, message.get_srcSystem(), message.get_srcComponent()
        if message.count > MOST:
            yield _ack(system, component, mavlink.MAV_MISSION_NO_SPACE, kind)
        elif message.count == 0:
            self.items[kind] = []
            self._changed(kind)
            yield _ack(system, component, ACCEPTED, kind)
        else:
            self._uploads[kind] = upload = Upload(system, component, message.count, now)
            yield _request(upload, kind)

    def _take(self, message: Message, now: float) -> Iterator[Message]:
        kind, source = message.mission_type, (message.get_srcSystem(), message.get_srcComponent())
        upload = self._uploads.get(kind)
        if upload is None or upload.source != source:
            return
        if message.seq == len(upload.items):
            upload.items.append(_as_int(message))
            upload.asked, upload.tries = now, 1
        if len(upload.items) < upload.count:
            yield _request(upload, kind)
            return
        del self._uploads[kind]
        self.items[kind] = upload.items
        self._changed(kind)
        yield _ack(*source, ACCEPTED, kind)


def _request(upload: Upload, kind: int) -> Message:
    return mavlink.MAVLink_mission_request_message(*upload.source, len(upload.items), kind)


def _ack(system: int, component: int, result: int, kind: int) -> Message:
    return mavlink.MAVLink_mission_ack_message(system, component, result, kind)


def _as_int(item: Message) -> Message:
    if item.get_type() == "MISSION_ITEM_INT":
        return item
    x, y = (round(max(-180.0, min(180.0, value)) * DEGREES) if value == value else 0 for value in (item.x, item.y))
    return mavlink.MAVLink_mission_item_int_message(
        item.target_system,
        item.target_component,
        item.seq,
        item.frame,
        item.command,
        item.current,
        item.autocontinue,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        x,
        y,
        item.z,
        item.mission_type,
    )
