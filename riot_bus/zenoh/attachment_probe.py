"""A short subscription to a key that collects the attachments of its messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release
from riot_bus.zenoh.session_config import ANSWER_S

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import zenoh

_ENOUGH = 16  # one of each publisher would do, and keys have few publishers; a guess
_LONGEST = 256  # those of rmw_zenoh have 33 or 77 bytes; 16 of them take 4 KiB at most


class AttachmentProbe:
    """Collects attachments of a key's messages, including those that publishers keep for late joiners.

    Args:
        heard: Function called on a thread of Zenoh for each new attachment.
    """

    def __init__(self, key: str, sessions: Sequence[zenoh.Session], heard: Callable[[], None]) -> None:
        self.attachments: list[bytes] = []
        self._heard = heard
        self._listeners: list[Any] = []
        for session in sessions:
            zenoh = library_of(session)
            try:
                pin(session, key)
                self._listeners.append(
                    session.declare_subscriber(key, zenoh.handlers.Callback(self._take, indirect=False))
                )
                session.get(
                    f"{key}/@adv/pub/**",
                    zenoh.handlers.Callback(self._take_reply, indirect=False),
                    consolidation=zenoh.ConsolidationMode.NONE,
                    accept_replies=zenoh.ReplyKeyExpr.ANY,
                    allowed_destination=zenoh.Locality.REMOTE,  # not our own stand-ins for caches
                    timeout=ANSWER_S,
                )
            except zenoh.ZError:  # it is closed
                continue

    def close(self) -> None:
        """End the subscriptions; safe to call twice."""
        listeners, self._listeners = self._listeners, []
        release(*listeners)

    def _take_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._take(reply.ok)

    def _take(self, sample: zenoh.Sample) -> None:
        attachment = sample.attachment
        if attachment is None or len(self.attachments) >= _ENOUGH or len(attachment) > _LONGEST:
            return
        self.attachments.append(attachment.to_bytes())
        self._heard()
