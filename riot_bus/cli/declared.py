"""Options of commands from their declarations, the fields of dataclasses: see `riot_bus.vocabulary.flags.Flag`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field
from functools import update_wrapper
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

import typer

from riot_bus.vocabulary.flags import Flag, flags_of

CommandT = TypeVar("CommandT", bound="Callable[..., None]")
OptionsT = TypeVar("OptionsT")


def declared(kind: type, *only: str, before: str = "form", remote: bool = False) -> Callable[[CommandT], CommandT]:
    """Add the options that a dataclass declares to a command, which gets those with a value as `**given`.

    Args:
        kind: The dataclass; names in `given` are those of its fields.
        only: Names of the fields to add; by default all.
        before: Parameter of the command that follows these options in its help; they are the last ones without it.
        remote: Whether only options that may be requested of a robot are added.
    """

    def decorate(command: CommandT) -> CommandT:
        flags = [
            each for each in flags_of(kind) if (each[1].remote or not remote) and (each[0].name in only or not only)
        ]

        def run(**values: Any) -> None:
            command(**read_options(flags, values))

        parameters = inspect.signature(command, eval_str=True).parameters.values()
        own = [each for each in parameters if each.kind is not inspect.Parameter.VAR_KEYWORD]
        place = next((place for place, each in enumerate(own) if each.name == before), len(own))
        own[place:place] = [parameter_of(*each) for each in flags]
        return shown_as(command, run, own)

    return decorate


def options_of(kind: type[OptionsT], given: dict[str, Any], **more: Any) -> OptionsT:
    """Return the options of a dataclass that are among `given`, and remove them there; the others are left."""
    return kind(**more, **{field.name: given.pop(field.name) for field, _, _ in flags_of(kind) if field.name in given})


def read_options(flags: Sequence[tuple[Field[Any], Flag, list[str]]], values: dict[str, Any]) -> dict[str, Any]:
    """Return the values of a command line; of these options, only those with a value, read from the user's text."""
    for field, flag, names in flags:
        value = values.pop(field.name)
        if value is not None:
            values[field.name] = flag.read(value, names[0]) if flag.read else value
    return values


def shown_as(command: CommandT, run: Callable[..., None], parameters: Sequence[inspect.Parameter]) -> CommandT:
    """Return `run` as a command with the name and help of another one."""
    update_wrapper(run, command)
    vars(run).update(__signature__=inspect.Signature(parameters), __annotations__={})
    return run  # type: ignore[return-value]  # for typer, it has other parameters


def parameter_of(field: Field[Any], flag: Flag, names: list[str]) -> inspect.Parameter:
    """Return an option of a dataclass as a parameter that typer reads."""
    kind, default = get_args(field.type)[0], None if field.default is MISSING else field.default
    many = next((each for each in (kind, *get_args(kind)) if get_origin(each) in (Sequence, Mapping)), None)
    if many is not None:  # repeatable; a table is read from its rows
        kind, default = list[get_args(many)[0]] | None, None  # type: ignore[misc]  # known at run time
    elif flag.read:
        kind, default = str | None, flag.text
    elif get_origin(kind) is Literal:
        kind = str
    option = typer.Option(*names, metavar=flag.metavar, envvar=flag.env, help=flag.help, min=flag.least, max=flag.most)
    return inspect.Parameter(
        field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, option]
    )
