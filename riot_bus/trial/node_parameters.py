"""Parameters of running components, set before the inputs of a run: nodes of ROS 2, components of MAVLink."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from riot_bus.types.capabilities import ParameterRequest
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.zenoh.segment_port import SegmentPort, open_port

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.system.system_file import Parameter
    from riot_bus.trial.context import Context
    from riot_bus.trial.setup import TrialSetup
    from riot_bus.types.port import SegmentAccess
    from riot_bus.vocabulary.message import Scalar


def set_parameters(setup: TrialSetup, names: Sequence[str], chosen: Mapping[str, Scalar]) -> dict[str, str]:
    """Set the parameters that running components take, each to its chosen or its nominal value.

    One that is refused is set to its nominal value, since a process that goes on has that of an earlier run.

    Args:
        setup: Setup in which the components are ready.
        names: Names of the components inside the system.
        chosen: Values by parameter; others are nominal.

    Returns:
        Refused parameters, each with the value, the node and the reason.

    Raises:
        ConfigError: A nominal value is refused, or a value is of a type that the parameter cannot have.
        EnvironmentFaultError: A node does not answer though all its values are nominal.
    """
    context, network = setup.context, setup.network
    if not context.file.external.in_nodes:
        return {}
    with ExitStack() as stack:
        segments = sorted(set(map(network.segment_of, names)))
        ports = [stack.enter_context(open_port(SegmentPort, [network.bus.endpoint(each)])) for each in segments]
        return set_in_nodes(
            context,
            chosen,
            ports,
            timeout=max(context.file.components[name].ready.timeout for name in names),
            alive=lambda: setup.processes.alive(names),
        )


def set_in_nodes(
    context: Context,
    chosen: Mapping[str, Scalar],
    ports: Sequence[SegmentAccess],
    *,
    timeout: float,
    alive: Callable[[], bool],
) -> dict[str, str]:
    """Set parameters through ports; see `set_parameters`.

    Args:
        context: Context of the system.
        chosen: Values by parameter; others are nominal.
        ports: The segments of the components inside.
        timeout: Seconds within which each node has to answer.
        alive: Function that returns whether the components still run.
    """
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
