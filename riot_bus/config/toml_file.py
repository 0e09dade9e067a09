"""Reading TOML files that people write: mistakes are reported with file, line, table and suggestion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.given_files import MOST_TOML, given_text
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.toml_text import parse_toml

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterable, Sequence
    from pathlib import Path

    from pydantic import BaseModel, ValidationError


class MistakeError(ValueError):
    """A mistake in a table; `explained` finds it in pydantic's error.

    Args:
        place: Keys below the table.
    """

    def __init__(self, message: str, *, hint: str | None = None, place: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.message, self.hint, self.place = message, hint, list(place)


def read_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Return a file's document and its text.

    Raises:
        ConfigError: It cannot be read, or is not TOML.
    """
    try:
        text = given_text(path, most=MOST_TOML)
    except OSError as error:
        raise ConfigError(
            f"cannot read the system file: {error.strerror}",
            where=str(path),
            hint="name one with --system, or see examples/rover/riot.toml",
        ) from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"not UTF-8: {error.reason} at byte {error.start}", where=str(path)) from None
    return parse_toml(text, where=str(path)), text


def explained(
    error: ValidationError,
    path: Path,
    text: str,
    known_keys: Callable[[list[str]], Iterable[str]],
    *,
    prefix: Sequence[str] = (),
) -> ConfigError:
    """Turn pydantic's error into one with file, line, table and hint.

    `known_keys` returns the keys that a table may have; `prefix` are the tables above what was validated.
    """
    problem: Any = error.errors()[0]
    place = [*prefix, *(str(part) for part in problem["loc"])]
    hint = None
    cause = problem.get("ctx", {}).get("error")
    if isinstance(cause, MistakeError):
        message, hint = cause.message, cause.hint
        place += cause.place
    elif problem["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        message = f"unknown key {place[-1]!r}"
        hint = did_you_mean(place[-1], known_keys(place[:-1]))
    elif problem["type"] == "missing":
        message = f"key {place[-1]!r} is missing"
    else:
        message = f"{problem['msg']} (got {problem.get('input')!r})"
    return ConfigError(message, where=place_of(path, text, place), hint=hint or None)


def explained_key(
    error: ValidationError, where: str, tags: Container[str], table_at: Callable[[list[str | int]], type[BaseModel]]
) -> ConfigError:
    """Turn pydantic's error into one with the path of the key, such as `inject[0].topic`, and hint.

    `tags` are the names of alternatives of a value, which are not keys of the file; `table_at` returns the table that a
    key is in.
    """
    problems = error.errors()
    first = next((each for each in problems if each["type"] == "extra_forbidden"), problems[0])
    *outer, last = first["loc"]
    unknown = first["type"] == "extra_forbidden"  # a key from the file, which may have the name of a tag
    place: list[str | int] = [part for part in outer if part not in tags]
    place += [last] if unknown or last not in tags else []
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")
    where = f"{where}: {key}" if key else where
    if unknown:
        word = str(last)
        hint = did_you_mean(word, table_at(place).model_fields)
        return ConfigError(f"unknown key {word!r}", where=where, hint=hint)
    given = first["input"]
    shown = f" (found {given!r})" if not isinstance(given, dict | list) else ""
    return ConfigError(first["msg"].removeprefix("Value error, ") + shown, where=where)


def place_of(path: Path, text: str, place: list[str]) -> str:
    """Return `file:line: [table]` of a key."""
    where = f"{path}:{line_of(text, place)}"
    return f"{where}: [{'.'.join(place[:-1])}]" if len(place) > 1 else where


def line_of(text: str, place: list[str]) -> int:
    """Return the line that a key most likely stands on: its table's header first, then the key itself."""
    lines = text.splitlines()
    names = [part for part in place if not part.isdigit()]
    at = 0
    for depth in range(len(names), 0, -1):
        header = ".".join(names[:depth])
        for number, line in enumerate(lines):
            if line.strip().strip("[]").strip().replace('"', "") == header:
                at = number
                break
        else:
            continue
        break
    if names:
        for number in range(at, len(lines)):
            if lines[number].split("=")[0].strip().strip("\"'") == names[-1]:
                return number + 1
    return at + 1
