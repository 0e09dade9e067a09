"""Waiting until the components of one trial are ready: connected, subscribed, at rest, and what `ready` asks for."""

from __future__ import annotations

import functools
import logging
import socket
import time
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

from riot_bus.router.services.offer import ServiceOffer
from riot_bus.trial.processes import last_words
from riot_bus.trial.settling import POLL
from riot_bus.types.capabilities import ParameterRequest
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, PayloadError
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import parse_selector
from riot_bus.zenoh.segment_port import SegmentPort, open_port

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from riot_bus.processes.launcher import Launcher
    from riot_bus.system.system_file import Parameter, Ready
    from riot_bus.trial.context import Context
    from riot_bus.trial.network import TrialNetwork
    from riot_bus.trial.observation import Observation
    from riot_bus.trial.processes import TrialProcesses
    from riot_bus.types.port import SegmentAccess
    from riot_bus.vocabulary.message import Message, Scalar

_LOG = logging.getLogger(__name__)


class Readiness:
    """Readiness of components; a component is watched by `expect` before it is started."""

    def __init__(
        self,
        context: Context,
        launcher: Launcher,
        network: TrialNetwork,
        processes: TrialProcesses,
        observation: Observation,
    ) -> None:
        self._context, self._launcher = context, launcher
        self._network, self._processes, self._observation = network, processes, observation
        self._published: set[str] = set()
        self._offers: dict[str, ServiceOffer] = {}

    def close(self) -> None:
        """End the observation of services."""
        for offer in self._offers.values():
            offer.close()

    def expect(self, name: str) -> None:
        """Observe the topic and the service by which a component will say that it is ready."""
        ready, segment, bus = (
            self._context.file.components[name].ready,
            self._network.segment_of(name),
            self._network.bus,
        )
        if ready.topic is not None:
            selected = parse_selector(ready.topic)
            for expression in self._context.topics(selected.topic):
                bus.subscribe(segment, expression, functools.partial(self._hear, name, selected.where))
        if ready.service is not None and name not in self._offers:
            self._offers[name] = ServiceOffer(bus.segment(segment).session, ready.service, self._context.registry)

    def _hear(self, name: str, where: str | None, message: Message) -> None:
        """Note that a component has published what its `ready` asks for."""
        kind = self._context.registry.type_of_message(message)
        with suppress(PayloadError, TypeError):  # the field is not there, or is of another type
            if where is None or (kind and parse_predicate(where)(lambda path: kind.read(message.payload, path))):
                self._published.add(name)

    def wait_subscribed(self, name: str, keys: Iterable[str]) -> None:
        """Wait until the only component on its segment has subscribed to keys.

        Raises:
            EnvironmentFaultError: It died before, or did not subscribe in time.
        """
        segment, timeout = self._network.segment_of(name), self._context.file.components[name].ready.timeout
        missing = self._network.bus.wait_subscribed(
            segment, list(keys), timeout=timeout, alive=lambda: self._processes.runs(name)
        )
        self._check_alive([name])
        if missing:
            topic = self._context.registry.topic(missing[0])
            raise self._did_not_start(name, f"has not subscribed to {topic} within {timeout:g} s")
        self._wait_declared([name])
        self._watch([name])

    def wait_ready(self, names: Sequence[str]) -> None:
        """Wait until components have connected and come to rest, so whatever they declare at start is declared.

        Nodes behind a bridge may be at rest and not known yet, so declared inputs are waited for as well; one
        without a subscriber is not an error.

        Raises:
            EnvironmentFaultError: One died before, or they did not connect in time.
        """
        network, components = self._network, self._context.file.components
        timeout = max((components[name].ready.timeout for name in names), default=0.0)
        deadline = time.monotonic() + timeout
        for segment in set(map(network.segment_of, names)):
            here = [name for name in names if network.segment_of(name) == segment]
            while network.connected(segment) < len(here):
                self._check_alive(names)
                if time.monotonic() > deadline:
                    what = f"has not connected to {network.bus.endpoint(segment)} within {timeout:g} s"
                    raise self._did_not_start(here[-1], f"(or another of {', '.join(here)}) {what}")
                time.sleep(POLL)
            inputs = self._context.topics(*sorted({topic for name in here for topic in components[name].inputs}))
            left = deadline - time.monotonic()
            network.bus.wait_subscribed(
                segment, inputs, timeout=left, alive=lambda: all(map(self._processes.runs, names))
            )
        self._wait_declared(names)
        self._watch(names)
        known = self._context.idle["; ".join(self._processes.alike[name] for name in names)]
        self._observation.come_to_rest(names, known, deadline=deadline)
        self._check_alive(names)

    def set_parameters(self, names: Sequence[str], chosen: Mapping[str, Scalar]) -> dict[str, str]:
        """Set the parameters that running components take, each to its chosen or its nominal value.

        One that is refused is set to its nominal value, since a process that goes on has that of an earlier run.

        Returns:
            Refused parameters, each with the value, the node and the reason.

        Raises:
            ConfigError: A nominal value is refused, or a value is of a type that the parameter cannot have.
            EnvironmentFaultError: A node does not answer though all its values are nominal.
        """
        network, file = self._network, self._context.file
        if not file.external.in_nodes:
            return {}
        with ExitStack() as stack:
            segments = sorted(set(map(network.segment_of, names)))
            ports = [stack.enter_context(open_port(SegmentPort, [network.bus.endpoint(each)])) for each in segments]
            return set_in_nodes(
                self._context,
                chosen,
                ports,
                timeout=max(file.components[name].ready.timeout for name in names),
                alive=lambda: self._processes.alive(names),
            )

    def _watch(self, names: Iterable[str]) -> None:
        """Record native stacks at fatal signals from now on, and find components whose processes are elsewhere."""
        for name in names:
            self._processes.find_inside(name)
        components = self._context.file.components
        traced = [self._processes.started[name].pid for name in names if components[name].is_process]
        if traced and (cannot := self._launcher.watch(traced)):
            _log_untraced(cannot)

    def _wait_declared(self, names: Iterable[str]) -> None:
        """Wait for what `ready` in riot.toml asks for."""
        for name in names:
            ready = self._context.file.components[name].ready
            while (missing := self._missing(name, ready)) is not None:
                self._check_alive([name])
                if time.monotonic() - self._processes.started_at[name] > ready.timeout + ready.after:
                    raise self._did_not_start(name, f"{missing} within {ready.timeout:g} s")
                time.sleep(POLL)

    def _missing(self, name: str, ready: Ready) -> str | None:
        """Return what is still missing of what `ready` asks for; None if nothing is."""
        process = self._processes.started[name]
        if self._context.file.components[name].attach is not None and not process.printed().endswith("\n"):
            return "has not connected, or is not a process of this machine that this user may inspect"
        if ready.line is not None and ready.line not in process.printed() and ready.line not in process.errors():
            return f"has not printed {ready.line!r}"
        if ready.topic is not None and name not in self._published:
            return f"has not published on {ready.topic}"
        if ready.service is not None and not self._offers[name].there():
            return f"does not offer the service {ready.service}"
        if ready.port is not None:
            port = self._processes.placeholders.free_port(ready.port) if isinstance(ready.port, str) else ready.port
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)):
                    return f"does not listen on port {port}"
        if time.monotonic() - self._processes.started_at[name] < ready.after:
            return f"is not ready before {ready.after:g} s"
        return self._processes.why_not_ready(name)

    def _check_alive(self, names: Iterable[str]) -> None:
        for name in names:
            self._processes.check_way(name)
            if not self._processes.alive([name]):
                status = self._processes.started[name].status
                raise self._did_not_start(name, f"ended with status {status} before it was ready")

    def _did_not_start(self, name: str, what: str) -> EnvironmentFaultError:
        hint = last_words(self._processes.started[name])
        if excess := self._processes.excess(name):
            what = f"was ended before it was ready: {excess[1]}"
            hint = f"write limits = {{ {excess[0]} = ... }} with more than that if it is right"
        return EnvironmentFaultError(f"component {name!r} {what}", where=str(self._context.file.path), hint=hint)


@functools.cache
def _log_untraced(why: str) -> None:
    _LOG.warning("crashes by a signal are told apart by the signal alone: components cannot be traced (%s)", why)


def set_in_nodes(
    context: Context,
    chosen: Mapping[str, Scalar],
    ports: Sequence[SegmentAccess],
    *,
    timeout: float,
    alive: Callable[[], bool],
) -> dict[str, str]:
    """Set parameters through ports; see `Readiness.set_parameters`."""
    described, where = context.file.external.in_nodes, f"{context.file.path}: external.parameters"

    def set_to(node: str, values: Mapping[str, Scalar]) -> dict[str, str]:
        adapter = context.registry.parameter_adapter(node)
        assert adapter is not None, "`open_system` has checked this"
        called = {described[key].name or key: key for key in values}
        typed = {name: _typed(values[key], described[key]) for name, key in called.items()}
        why = adapter.set_parameters(ParameterRequest(node, typed, ports, timeout, alive))
        return {called[name]: reason for name, reason in why.items()}

    refused: dict[str, str] = {}
    for node in dict.fromkeys(str(one.node) for one in described.values()):
        nominal = {key: one.nominal for key, one in described.items() if one.node == node}
        values = {key: chosen.get(key, value) for key, value in nominal.items()}
        try:
            why = set_to(node, values)
            again = {key: nominal[key] for key in why if values[key] != nominal[key]}
            wrong = {key: reason for key, reason in why.items() if key not in again}
            wrong |= set_to(node, again) if again else {}
        except EnvironmentFaultError as error:
            if values == nominal:
                error.where = error.where or where
                raise
            why, wrong = {key: error.message for key in values if values[key] != nominal[key]}, {}
        for key, reason in wrong.items():
            raise ConfigError(f"{node} refuses the nominal value {nominal[key]!r}: {reason}", where=f"{where}.{key}")
        refused |= {key: f"{node} refused {values[key]!r}: {reason}" for key, reason in why.items()}
    return refused


def _typed(value: Scalar, described: Parameter) -> Scalar:
    """Return a value in the type of the nominal one where both are numbers: nodes take no integer for a float."""
    return float(value) if type(described.nominal) is float and isinstance(value, int) else value
