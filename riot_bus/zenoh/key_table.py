"""What a receiving loop knows of each key: learned from a first sample, compared with later ones, and bounded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh

_MOST_SENDERS = 64  # of a key: timestamps may carry any id, and few keys have more publishers

Known = TypeVar("Known", bound="KnownKey")


class KnownKey:
    """A key and the settings of the sample from which it was learned; loops compare others with these."""

    def __init__(self, key: str, sample: Any) -> None:
        self.key = key
        self.priority, self.congestion = sample.priority, sample.congestion_control
        self.express, self.encoding = sample.express, sample.encoding


class KeyTable(Generic[Known]):
    """What one loop knows of each key, and who has sent its messages; `forget` may be called on any thread.

    Args:
        learn: Function of a key and a sample of it; returns None if the loop has nothing to do with the key.
        most: Number of keys; anybody may invent more, and then all are forgotten.
        forget: Function that is called when all are forgotten.
    """

    def __init__(
        self, learn: Callable[[str, Any], Known | None], *, most: int, forget: Callable[[], None] = lambda: None
    ) -> None:
        self.known: dict[zenoh.KeyExpr, Known | None] = {}
        self._learn, self._most, self._forget = learn, most, forget
        self._senders: dict[str, set[str]] = {}

    def learn(self, key: zenoh.KeyExpr, sample: Any) -> Known | None:
        """Find out, from a sample, what there is to know of a key."""
        if len(self.known) >= self._most:
            self.forget()
        known = self.known  # if `forget` is called now, what is outdated goes to the former ones
        found = known[key] = self._learn(str(key), sample)
        return found

    def forget(self) -> None:
        """Forget all keys, since what was learned of them may have changed; senders are kept."""
        self.known = {}
        self._forget()

    def note_sender(self, key: str, sample: Any) -> None:
        """Note the id in a sample's timestamp, if it has one; a sample of all messages is enough."""
        stamp = sample.timestamp
        if stamp is not None and (key in self._senders or len(self._senders) < self._most):
            zids = self._senders.setdefault(key, set())
            if len(zids) < _MOST_SENDERS:
                zids.add(str(stamp.get_id()))

    def senders(self) -> dict[str, set[str]]:
        """Return the ids in the timestamps of messages, by key."""
        return {key: set(zids) for key, zids in list(self._senders.items())}
