"""What a running router intercepts: the user's keys, the topics of the interceptors, and those of an injection plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.router.services.selection import service_keys, split
from riot_bus.types.serve import REQUEST
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError, did_you_mean
from riot_bus.zenoh.session import canonical
from riot_bus.zenoh.session_config import OWN_CHUNK

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from riot_bus.config.router_settings import RouterSettings
    from riot_bus.inject.injection_plan import InjectionPlan
    from riot_bus.router.bus import Bus
    from riot_bus.types.registry import TypeRegistry

_MOST_KEYS = 256
"""Keys that a router intercepts: each costs two threads in every segment, and to add 250 takes 1.1 s."""
_LONGEST_KEY = 1024  # letters; names of DDS topics have at most 255


def topics_of(interceptor: object) -> list[str] | None:
    """Return the topics that an interceptor wants; None if it names none and takes all that is intercepted."""
    from riot_bus.pipeline.conditions import Selective
    from riot_bus.vocabulary.selector import parse_selector

    if isinstance(interceptor, Selective):
        chosen = interceptor.when.selectors()
        return topics_of(interceptor.interceptor) if chosen is None else [topic for topic, _ in chosen]
    topics = getattr(interceptor, "topics", None)
    if topics is None:
        return None
    return [parse_selector(text).topic for text in ([topics] if isinstance(topics, str) else topics)]


def expressions_of(
    settings: RouterSettings, *, interceptors: Sequence[object], plan: InjectionPlan | None, registry: TypeRegistry
) -> tuple[list[str], list[str]]:
    """Return the key expressions of topics and of services that a router will intercept at first.

    Raises:
        ConfigError: A key cannot be intercepted, or an interceptor would see nothing.
    """
    keys = wanted_keys(settings, registry)
    found = Interception(_nothing_yet, keys=keys, interceptors=interceptors, plan=plan, registry=registry)
    return found.expressions, found.services


def wanted_keys(settings: RouterSettings, registry: TypeRegistry) -> list[str]:
    """Return the keys that a router's settings select for interception, services included."""
    return [*settings.intercept, *service_keys(settings.services, registry)]


def _nothing_yet() -> Bus:
    raise EnvironmentFaultError("this router is not open", hint="use it in a with statement")


class Interception:
    """Makes a bus intercept what user, interceptors and plan want; not thread-safe.

    Args:
        keys: Keys that the user wants to intercept; `KEY/@request` means the service of this key.
        plan: Injection plan, carried out after the interceptors.

    Raises:
        ConfigError: A key cannot be intercepted, or an interceptor would see nothing.
    """

    def __init__(
        self,
        bus: Callable[[], Bus],
        *,
        keys: Sequence[str],
        interceptors: Sequence[object],
        plan: InjectionPlan | None,
        registry: TypeRegistry,
    ) -> None:
        self._plan = plan
        self.keys = list(dict.fromkeys(keys))
        self._bus = bus
        self._interceptors = tuple(interceptors)
        self._registry = registry
        for each in interceptors:
            if topics_of(each) is None and not keys:
                name = type(each).__name__
                raise ConfigError(f"interceptor {name} would see nothing", hint="say which keys: --intercept KEYEXPR")
        self.expressions, self.services = self._needed(((), ()), self.keys, plan)

    @property
    def topics(self) -> list[str]:
        """All topics and keys to intercept, as the user wrote them."""
        return self._wanted(self.keys, self.plan)

    @property
    def plan(self) -> InjectionPlan | None:
        """The plan that is carried out; one that has ended is given up at the next change."""
        return None if self._plan is None or self._plan.injector.ended() else self._plan

    def interceptors(self, plan: InjectionPlan | None) -> list[object]:
        """Return all interceptors, including the injector of this plan."""
        return [*self._interceptors, *([plan.injector] if plan is not None else [])]

    def add(self, keys: Sequence[str]) -> list[str]:
        """Intercept more keys; return what is intercepted now."""
        return self._change([*dict.fromkeys([*self.keys, *_checked(keys)])], self.plan)

    def remove(self, keys: Sequence[str]) -> list[str]:
        """Stop intercepting some keys; return what is intercepted now."""
        for key in _checked(keys):
            if key not in self.keys:
                others = [each for each in self.topics if each not in self.keys]
                hint = "an interceptor or the plan wants it" if key in others else did_you_mean(key, self.keys)
                raise ConfigError(f"{key!r} is not intercepted on your account", where="intercept/remove", hint=hint)
        return self._change([each for each in self.keys if each not in keys], self.plan)

    def set_plan(self, plan: InjectionPlan | None) -> list[str]:
        """Carry out another plan or none; return what is intercepted now."""
        return self._change(self.keys, plan)

    def _change(self, keys: list[str], plan: InjectionPlan | None) -> list[str]:
        bus, former = self._bus(), (self.keys, self._plan, self.expressions, self.services)
        expressions, services = self._needed((self.expressions, self.services), keys, plan)
        if plan is not self._plan:
            bus.set_interceptors(self.interceptors(plan))
        try:
            if (expressions, services) != (self.expressions, self.services):
                bus.set_intercept(expressions, services=services)
        except RiotError:
            self.keys, self._plan, self.expressions, self.services = former
            if plan is not self._plan:
                bus.set_interceptors(self.interceptors(self._plan))
            bus.set_intercept(self.expressions, services=self.services)  # else the segments would stay apart
            raise
        self.keys, self._plan, self.expressions, self.services = keys, plan, expressions, services
        return self.intercepted

    @property
    def intercepted(self) -> list[str]:
        """What is intercepted at present, by name."""
        called = self._registry.topic
        return [*map(called, self.expressions), *(f"{called(text)}/{REQUEST}" for text in self.services)]

    def _wanted(self, keys: Sequence[str], plan: InjectionPlan | None) -> list[str]:
        topics = [*keys]
        for each in self.interceptors(plan):
            topics += topics_of(each) or ()
        return list(dict.fromkeys(topics))

    def _needed(
        self, present: tuple[Sequence[str], Sequence[str]], keys: Sequence[str], plan: InjectionPlan | None
    ) -> tuple[list[str], list[str]]:
        """Return the expressions of topics and of services to intercept."""
        topics, services = split(self._wanted(keys, plan))
        if len(topics) + len(services) > _MOST_KEYS or any(len(each) > _LONGEST_KEY for each in (*topics, *services)):
            text = f"more than {_MOST_KEYS} key expressions, or one longer than {_LONGEST_KEY} letters"
            raise ConfigError(text, where="intercept", hint="use wildcards, such as robot/**")
        return self._expressions(present[0], topics), self._expressions(present[1], services)

    def _expressions(self, present: Sequence[str], names: Iterable[str]) -> list[str]:
        """Return what to intercept: present expressions that are still wanted, and those that they do not include."""
        from riot_bus.zenoh import api as zenoh

        wanted = canonical([self._registry.key_expression(name) for name in names])
        for text in wanted:
            if text.split("/")[0] in ("@", OWN_CHUNK):
                raise ConfigError(f"{text!r} cannot be intercepted", hint="routers talk to each other there")
        needed = [text for text in present if text in wanted]
        parsed = [zenoh.KeyExpr(text) for text in needed]
        for text in wanted:
            expression = zenoh.KeyExpr(text)
            if not any(each.includes(expression) for each in parsed):
                needed.append(text)
                parsed.append(expression)
        return needed


def _checked(keys: Iterable[str]) -> list[str]:
    found = list(keys)
    if not found:
        hint = "such as riot ctl intercept add /odom"
        raise ConfigError("no key expression is given", where="intercept", hint=hint)
    return found
