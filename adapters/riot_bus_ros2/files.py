"""Definition files that the user names: `pkg/msg/Name.msg`, `pkg/srv/Name.srv`, `pkg/action/Name.action`, or `.idl`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus_ros2.definitions import KINDS, DefinitionError, parse_file, references
from riot_bus_ros2.sources import read_interface

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus_ros2.definitions import Definition
    from riot_bus_ros2.store import TypeStore


def load_files(files: Sequence[Path], store: TypeStore) -> None:
    """Register files, or all files in directories, in the layout shown above.

    Raises:
        ConfigError: A file is missing, misplaced, does not parse, or names an unknown type.
    """
    places: dict[Path, dict[str, Definition]] = {}
    for file in _interfaces(files):
        places[file] = _read(file)
        store.register(places[file])
    for file, definitions in places.items():
        _check_references(file, definitions, store)


def _interfaces(files: Sequence[Path]) -> list[Path]:
    found: list[Path] = []
    for file in files:
        inside = [file]
        if file.is_dir():
            inside = sorted(each for kind in KINDS for each in file.rglob(f"{kind}/*.{kind}"))
            known = {each.with_suffix("") for each in inside}  # rosidl installs an .idl beside each of these
            idl = sorted(each for kind in KINDS for each in file.rglob(f"{kind}/*.idl"))
            inside += [each for each in idl if each.with_suffix("") not in known]
        if not inside:
            raise ConfigError("no .msg files in this directory", where=str(file), hint="expected pkg/msg/Name.msg")
        found += inside
    for file in found:
        kind, package = file.parent.name, file.resolve().parent.parent.name
        if kind not in KINDS or file.suffix not in (f".{kind}", ".idl") or not package.isidentifier():
            hint = "move or rename it; .srv files belong in pkg/srv, .action files in pkg/action"
            raise ConfigError("not a file in a layout pkg/msg/Name.msg", where=str(file), hint=hint)
    return [file.resolve() for file in found]


def _read(file: Path) -> dict[str, Definition]:
    name = f"{file.parent.parent.name}/{file.parent.name}/{file.stem}"
    try:
        return read_interface(file, name)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the definition: {error}", where=str(file)) from error
    except DefinitionError as error:
        if file.suffix == ".idl":
            hint = "the subset of IDL that rosidl writes is read"
            raise ConfigError(f"cannot parse the IDL: {str(error)[:200]}", where=str(file), hint=hint) from error
        line = _first_bad_line(file, name)
        if line is None:
            raise ConfigError(f"cannot parse the definition: {str(error)[:200]}", where=str(file)) from error
        source = file.read_text().splitlines()[line - 1].strip()
        hint = "write it like 'float64[3] position'"
        raise ConfigError(f"cannot parse {source!r}", where=f"{file}:{line}", hint=hint) from error


def _first_bad_line(file: Path, name: str) -> int | None:
    """Return the number of the first line that is not valid as a .msg file on its own; None if all are."""
    for number, line in enumerate(file.read_text().splitlines(), 1):
        if line.strip() == "---":
            continue
        try:
            parse_file(f"{line}\n", f"{name.split('/')[0]}/msg/Line", ".msg")
        except DefinitionError:
            return number
    return None


def _check_references(file: Path, definitions: dict[str, Definition], store: TypeStore) -> None:
    for definition in definitions.values():
        for reference in references(definition):
            if store.definition(reference) is None:
                short = reference.rpartition("/")[2]
                lines = enumerate(file.read_text().splitlines(), 1)
                line = next((number for number, source in lines if short in source.partition("#")[0]), 1)
                hint = did_you_mean(reference, store.names())
                raise ConfigError(f"unknown type {reference!r}", where=f"{file}:{line}", hint=hint)
