"""Which topics of the logs are played, under which keys and how; pure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from riot_bus.bus.playing.options import parse_latched, parse_remaps
from riot_bus.bus.runtime import canonical
from riot_bus.errors import ConfigError, MissingExtraError, did_you_mean
from riot_bus.selector import key_matches
from riot_bus.types.offer import Offer, Offering

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from riot_bus.bus.playing.options import PlayOptions
    from riot_bus.types.model import Adapter
    from riot_bus.types.offer import RecordedTopic, SimClock

__all__ = ["Cast", "cast"]

_ROS_SCHEMAS = ("ros2msg", "ros2idl")


@dataclass(slots=True)
class Cast:
    """What is played.

    Attributes:
        keys: For each log, the key to play by the recorded key.
        offers: How to publish, by the key to play.
        names: What people call these keys.
        topics: What was recorded, by the key to play, for its type.
        clock: How to tell the time, if that is wanted.
    """

    keys: list[dict[str, str]] = field(default_factory=list)
    offers: dict[str, Offer] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    topics: dict[str, RecordedTopic] = field(default_factory=dict)
    clock: SimClock | None = None


def cast(logs: Sequence[Sequence[RecordedTopic]], options: PlayOptions, adapters: Sequence[Adapter]) -> Cast:
    """Decide what is played.

    Args:
        logs: The topics of each log.
        options: What is wanted.
        adapters: Asked in this order how to publish.

    Raises:
        ConfigError: Something is wanted that the logs do not hold, or that cannot be published.
    """
    remaps, latched = parse_remaps(options.remap), parse_latched(options.latched)
    topics = [topic for log in logs for topic in log]
    wanted = {"--topics": options.topics, "--exclude": options.exclude, "--latched": latched, "--remap": remaps}
    for where, texts in wanted.items():
        _check_known(texts, topics, where)
    offering = [each for each in adapters if isinstance(each, Offering)]
    found = Cast()
    if options.clock:
        clocks = (each.clock(options.domain) for each in offering)
        found.clock = next((clock for clock in clocks if clock is not None), None)
        if found.clock is None:
            raise MissingExtraError("rosbags", "ros2")
    for log in logs:
        keys: dict[str, str] = {}
        for topic in log:
            if options.topics and not any(_means(text, topic) for text in options.topics):
                continue
            if any(_means(text, topic) for text in options.exclude):
                continue
            offer = _offer(topic, _renamed(topic, remaps), options.domain, offering)
            if found.clock is not None and offer.key == found.clock.offer.key:
                continue  # ours takes its place
            depth = next((depth for text, depth in latched.items() if _means(text, topic)), None)
            offer = offer if depth is None else replace(offer, depth=depth)
            keys[topic.key] = offer.key
            known = found.offers.get(offer.key)
            found.offers[offer.key] = offer if known is None or known.depth is None else known
            found.names[offer.key] = _renamed(topic, remaps) or topic.name
            found.topics[offer.key] = topic
        found.keys.append(keys)
    if topics and not found.offers:
        raise ConfigError("nothing is left to play", hint=did_you_mean("", {each.name for each in topics}))
    return found


def _means(text: str, topic: RecordedTopic) -> bool:
    if text in (topic.name, topic.key) or key_matches(text, topic.key):
        return True
    return key_matches(text.strip("/"), topic.name.strip("/"))


def _check_known(texts: Iterable[str], topics: Sequence[RecordedTopic], where: str) -> None:
    for text in texts:
        if topics and not any(_means(text, topic) for topic in topics):
            hint = did_you_mean(text, {topic.name for topic in topics})
            raise ConfigError(f"the logs have no topic {text!r}", where=where, hint=hint)


def _renamed(topic: RecordedTopic, remaps: Mapping[str, str]) -> str | None:
    bare = topic.name.strip("/")
    for old, new in remaps.items():
        if not old.endswith("/**"):
            if old in (topic.name, topic.key) or old.strip("/") == bare:
                return new
            continue
        prefix = old.removesuffix("/**").strip("/")
        if not prefix or f"{bare}/".startswith(f"{prefix}/"):
            return f"{new.removesuffix('/**')}/{bare.removeprefix(prefix).strip('/')}".rstrip("/")
    return None


def _offer(topic: RecordedTopic, name: str | None, domain: int | None, offering: Sequence[Offering]) -> Offer:
    for adapter in offering:
        offer = adapter.offer(topic, name=name, domain=domain)
        if offer is not None:
            return offer
    if not topic.keyed and topic.encoding == "cdr" and topic.schema.encoding in _ROS_SCHEMAS and not offering:
        raise MissingExtraError("rosbags", "ros2")
    key = (topic.key if name is None else name).strip("/")
    (text,) = canonical([key])
    if "*" in text:
        raise ConfigError(f"{text!r} cannot be published to", where="--remap", hint="give it a name without wildcards")
    return Offer(text)
