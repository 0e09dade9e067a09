"""Options of commands from the dataclasses that their parameters have as types."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

from riot_bus.cli.declared import CommandT, options_of, parameter_of, read_options, shown_as
from riot_bus.vocabulary.flags import flags_of


def with_options(command: CommandT, known: Mapping[str, Any]) -> CommandT:
    """Give a command the options of each dataclass that is the type of one of its parameters.

    Args:
        known: Annotations that replace the command's own, by the name of the parameter.
    """
    parameters: list[inspect.Parameter] = []
    kinds: dict[str, type] = {}
    for each in inspect.signature(command, eval_str=True).parameters.values():
        if is_dataclass(each.annotation):
            kinds[each.name] = each.annotation  # type: ignore[assignment]  # no instance
            parameters += [parameter_of(*flag) for flag in flags_of(kinds[each.name])]
        else:
            parameters.append(each.replace(annotation=known.get(each.name, each.annotation)))

    def run(**values: Any) -> None:
        for name, kind in kinds.items():
            values[name] = options_of(kind, read_options(flags_of(kind), values))
        command(**values)

    return shown_as(command, run, parameters)


def annotation_of(kind: type, name: str) -> Any:
    """Return the annotation by which typer knows an option of a dataclass."""
    return next(parameter_of(*each).annotation for each in flags_of(kind) if each[0].name == name)
