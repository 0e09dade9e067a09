"""How interceptors are written: `'drop every=5 select=/odom'` on a command line, tables in riot.toml."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from riot_bus.interceptors.catalogue import build
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.toml_text import parse_toml

_KEY = re.compile(r"[A-Za-z_]\w*")


def parse(text: str) -> tuple[str, dict[str, Any]]:
    """Split `NAME key=value key=value`; the values of an option that is given twice become a list.

    Raises:
        ConfigError: The text is not of this form.
    """
    hint = "write NAME key=value ..., such as 'drop every=5 select=/odom', or FILE.py[:NAME]"
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise ConfigError(f"{text!r}: {error}", where="--interceptor", hint=hint) from None
    if not words:
        raise ConfigError("no interceptor is named", where="--interceptor", hint=hint)
    options: dict[str, Any] = {}
    for word in words[1:]:
        key, equals, value = word.partition("=")
        if not equals or not _KEY.fullmatch(key):
            raise ConfigError(f"{word!r} in {text!r} is not an option", where="--interceptor", hint=hint)
        if key in options:
            former = options[key]
            options[key] = [*(former if isinstance(former, list) else [former]), _value(value)]
        else:
            options[key] = _value(value)
    return words[0], options


def from_text(text: str) -> object:
    """Build what `--interceptor` names; a file's code is executed.

    Raises:
        ConfigError: It cannot be built.
    """
    use, options = parse(text)
    return build(use, options, where="--interceptor")


def from_tables(
    tables: Iterable[Mapping[str, Any]], *, where: str = "riot.toml", root: Path | None = None
) -> list[object]:
    """Build what `[[router.interceptors]]` names, in this order.

    Relative paths start from `root`, by default the working folder.

    Raises:
        ConfigError: One cannot be built.
    """
    made = []
    for number, table in enumerate(tables):
        place = f"{where}: router.interceptors[{number}]"
        options = dict(table)
        use = options.pop("use", None)
        if not isinstance(use, str):
            hint = 'write use = "drop", or use = "FILE.py:NAME"'
            raise ConfigError("which interceptor?", where=place, hint=hint)
        made.append(build(use, options, where=place, root=root))
    return made


def build_all(
    texts: Iterable[str], *, tables: Iterable[Mapping[str, Any]] = (), file: Path | None = None, seed: int = 0
) -> list[object]:
    """Build the interceptors of a riot.toml, then those of a command line; files that they name are executed.

    The seed is that of interceptors that have none of their own; 0 for none.

    Raises:
        ConfigError: One cannot be built.
    """
    common = {"seed": seed} if seed else {}
    where, root = ("riot.toml", None) if file is None else (str(file), file.resolve().parent)
    found = from_tables([{**common, **table} for table in tables], where=where, root=root)
    for text in texts:
        use, own = parse(text)
        found.append(build(use, {**common, **own}, where="--interceptor"))
    return found


def _value(text: str) -> Any:
    try:
        document = parse_toml(f"value = {text}", where="--interceptor")
    except ConfigError:
        return text
    value = document["value"]
    plain = isinstance(value, bool | int | float) and "#" not in text  # else the rest would be a comment
    return value if len(document) == 1 and (plain or isinstance(value, str | list | dict)) else text
