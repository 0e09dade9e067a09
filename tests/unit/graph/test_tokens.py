from __future__ import annotations

from typing import Any, cast

import pytest

from riot_bus.graph.tokens import ADVANCED, expressions, parse_token
from riot_bus.types.capabilities import Announcement
from riot_bus.types.registry import TypeRegistry

OWN = Announcement("aa", None, "", "/node", "", "", "own token")


class Registry:
    """A registry whose adapters know one kind of token."""

    def announcements(self) -> list[str]:
        return ["**/@own/**"]

    def announcement(self, token: str) -> Announcement | None:
        return OWN if "@own" in token else None


REGISTRY = cast(TypeRegistry, cast(Any, Registry()))


def test_adapters_are_asked_for_what_is_no_advanced_token() -> None:
    assert expressions(REGISTRY) == ["**/@own/**", ADVANCED]
    assert parse_token("x/@own/y", REGISTRY) is OWN
    assert parse_token("x/y", REGISTRY) is None


@pytest.mark.parametrize(
    ("token", "key", "role", "zid"),
    [
        ("a/@adv/pub/3f2a/12/_", "a", "publishes", "3f2a"),
        ("a/b/**/@adv/sub/3f/uhlc", "a/b/**", "subscribes", "3f"),
        ("a/@adv/pub/ff/1/more/and/more", "a", "publishes", "ff"),
        ("a/@adv/pub/1/2/3/@adv/sub/ff/1/_", "a/@adv/pub/1/2/3", "subscribes", "ff"),  # the last one counts
        ("a/@own/@adv/sub/ff/1/_", "a/@own", "subscribes", "ff"),
    ],
)
def test_advanced_tokens_tell_key_role_and_session(token: str, key: str, role: str, zid: str) -> None:
    found = parse_token(token, REGISTRY)
    assert found == Announcement(zid, role, key, "", "", "", "advanced token")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "token", ["@adv/pub/3f/1/_", "/@adv/pub/3f/1/_", "a/@adv/pub/3f", "a/@adv/pub/XY/1/_", "a/@adv/query/3f/1/_", ""]
)
def test_what_only_looks_like_one_is_not_known(token: str) -> None:
    assert parse_token(token, REGISTRY) is None
