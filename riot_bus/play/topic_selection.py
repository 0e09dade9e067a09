"""Which topics of the logs are played, under which keys and how; pure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from riot_bus.log.naming import in_full, means, parse_remaps, renamed
from riot_bus.play.options import parse_latched
from riot_bus.types.capabilities import Offer, PublishesAs
from riot_bus.types.serve import part_of
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError, did_you_mean
from riot_bus.zenoh.session import canonical

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from riot_bus.play.options import PlayOptions
    from riot_bus.types.capabilities import RecordedTopic, SimClock
    from riot_bus.types.model import Adapter

_ROS_SCHEMAS = ("ros2msg", "ros2idl")


@dataclass(slots=True)
class TopicSelection:
    """The topics to play.

    Attributes:
        keys: For each log, a mapping from recorded keys to keys to play.
        offers: Publisher settings, by the key to play.
        names: Topic names, by the key to play.
        topics: Recorded topics, by the key to play, for their types.
        clock: Settings for publishing the time, if that is wanted.
    """

    keys: list[dict[str, str]] = field(default_factory=list)
    offers: dict[str, Offer] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    topics: dict[str, RecordedTopic] = field(default_factory=dict)
    clock: SimClock | None = None


def cast(logs: Sequence[Sequence[RecordedTopic]], options: PlayOptions, adapters: Sequence[Adapter]) -> TopicSelection:
    """Decide what is played.

    Raises:
        ConfigError: Something is wanted that the logs do not hold, or that cannot be published.
    """
    remaps, latched = parse_remaps(options.remap), parse_latched(options.latched)
    topics = [topic for log in logs for topic in log]

    def full(text: str) -> str:
        return in_full(text, topics, lambda: adapters)

    options = replace(options, topics=[*map(full, options.topics)], exclude=[*map(full, options.exclude)])
    latched = {full(text): depth for text, depth in latched.items()}
    wanted = {"--topics": options.topics, "--exclude": options.exclude, "--latched": latched, "--remap": remaps}
    for where, texts in wanted.items():
        _check_known(texts, topics, where)
    offering = [each for each in adapters if isinstance(each, PublishesAs)]
    chosen = [[topic for topic in log if _is_wanted(topic, options)] for log in logs]
    found = TopicSelection()
    if options.clock:
        clocks = (each.clock([topic for log in chosen for topic in log], domain=options.domain) for each in offering)
        found.clock = next((clock for clock in clocks if clock is not None), None)
        if found.clock is None:
            raise MissingExtraError("rosbags", "ros2")
    for log in chosen:
        keys: dict[str, str] = {}
        for topic in log:
            if found.clock is not None and found.clock.name == (renamed(topic, remaps) or topic.name):
                continue  # the player's own clock replaces it
            offer = _offer(topic, renamed(topic, remaps), options.domain, offering)
            depth = next((depth for text, depth in latched.items() if means(text, topic)), None)
            offer = offer if depth is None else replace(offer, depth=depth)
            keys[topic.key] = offer.key
            known = found.offers.get(offer.key)
            found.offers[offer.key] = offer if known is None or known.depth is None else known
            found.names[offer.key] = renamed(topic, remaps) or topic.name
            found.topics[offer.key] = topic
        found.keys.append(keys)
    if topics and not found.offers:
        raise ConfigError("nothing is left to play", hint=did_you_mean("", {each.name for each in topics}))
    return found


def _is_wanted(topic: RecordedTopic, options: PlayOptions) -> bool:
    if part_of(topic.key) is not None or (options.topics and not any(means(text, topic) for text in options.topics)):
        return False
    return not any(means(text, topic) for text in options.exclude)


def _check_known(texts: Iterable[str], topics: Sequence[RecordedTopic], where: str) -> None:
    for text in texts:
        if topics and not any(means(text, topic) for topic in topics):
            hint = did_you_mean(text, {topic.name for topic in topics})
            raise ConfigError(f"the logs have no topic {text!r}", where=where, hint=hint)
        if part_of(text) is not None and where == "--topics":
            hint = "they are kept to be read; a player cannot answer them"
            raise ConfigError(f"requests and replies are not played: {text}", where=where, hint=hint)


def _offer(topic: RecordedTopic, name: str | None, domain: int | None, offering: Sequence[PublishesAs]) -> Offer:
    for adapter in offering:
        offer = adapter.offer(topic, name=name, domain=domain)
        if offer is not None:
            return offer
    if not topic.keyed and topic.encoding == "cdr" and topic.schema.encoding in _ROS_SCHEMAS and not offering:
        raise MissingExtraError("rosbags", "ros2")
    key = (topic.key if name is None else name).strip("/")
    hint = "rename it (--remap) or leave it out (--exclude)"
    try:
        (text,) = canonical([key])
    except ConfigError as error:
        raise ConfigError(error.message, where=topic.name, hint=hint) from error
    if "*" in text:
        raise ConfigError(f"{text!r} cannot be published to", where=topic.name, hint=hint)
    return Offer(text)
