"""Fetching of what late joiners get from advanced publishers, so that a log has latched topics from the beginning."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.router.advanced.source import announced
from riot_bus.router.worker import Worker
from riot_bus.zenoh.convert import is_delete
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.zenoh import api as zenoh

_TOKENS = "**/@adv/pub/**"


class LatchedCaches:
    """Queries of the publishers' caches, one for each publisher that announces a cache."""

    def __init__(
        self, session: zenoh.Session, *, wanted: Callable[[str], bool], record: Callable[[str, list[Any]], None]
    ) -> None:
        self._session, self._wanted, self._record = session, wanted, record
        self._closed = False
        self._worker = Worker("riot-latched")
        self._subscriber = session.liveliness().declare_subscriber(_TOKENS, self._token, history=True)

    def close(self) -> None:
        """Stop querying; safe to call twice."""
        if not self._closed:
            self._closed = True
            release(self._subscriber)
        self._worker.close()

    def _token(self, sample: zenoh.Sample) -> None:
        if not is_delete(sample):
            self._worker.do(partial(self._ask, str(sample.key_expr)))

    def _ask(self, token: str) -> None:
        zenoh = library_of(self._session)
        source = announced("", token)
        if self._closed or source is None or not self._wanted(source.key):
            return
        replies = self._session.get(
            f"{source.key}/@adv/pub/{source.zid}/{source.entity}/**",
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            timeout=2.0,  # publishers are asked one by one, so a silent one delays the others
        )
        samples = [reply.ok for reply in replies if reply.ok is not None and str(reply.ok.key_expr) == source.key]
        if samples:
            self._record(source.key, samples)
