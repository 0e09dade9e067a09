"""Load a plug-in class from a file that the user named: an interceptor, or a monitor."""

from __future__ import annotations

import inspect
import sys
import traceback
from pathlib import Path
from types import ModuleType

from riot_bus.vocabulary.errors import ConfigError, did_you_mean

_HINTS = {
    "message": "an interceptor is a class with a method message(self, event)",
    "judge": "a monitor is a class with a method judge(self, view)",
}


def load_class(path: str, *, method: str = "message") -> type:
    """Return the class in `FILE.py[:NAME]` that has a method of this name.

    The file's code is executed: call this only with what the user wrote on the command line. Without `NAME` the file
    must define exactly one class with such a method.

    Raises:
        ConfigError: The file is missing or does not run, the class is missing, or the choice is ambiguous.
    """
    file, name = _split(path)
    classes = _classes(file, method)
    if name is None:
        if len(classes) > 1:
            found = ", ".join(f"{each.__name__} (line {_line(each, method)})" for each in classes.values())
            hint = f"choose one, such as {file}:{next(iter(classes))}"
            raise ConfigError(
                f"several classes with a method {method}() in one file: {found}", where=str(file), hint=hint
            )
        if not classes:
            raise ConfigError(f"no class with a method {method}() in this file", where=str(file), hint=_HINTS[method])
        (name,) = classes
    elif name not in classes:
        hint = did_you_mean(name, classes) or _HINTS[method]
        raise ConfigError(f"no class {name!r} with a method {method}() in this file", where=str(file), hint=hint)
    return classes[name]


def _split(path: str) -> tuple[Path, str | None]:
    head, colon, name = path.rpartition(":")
    named = bool(colon) and name.isidentifier()
    file = Path(head if named else path)
    if not file.is_file():
        raise ConfigError(f"no such file: {str(file)!r}", where=path, hint="write FILE.py or FILE.py:NAME")
    return file, name if named else None


def _classes(file: Path, method: str) -> dict[str, type]:
    module = ModuleType(f"riot_bus_user_{file.stem}")
    module.__file__ = str(file)
    sys.modules[module.__name__] = module  # dataclasses and inspect look their module up there
    try:
        code = compile(file.read_bytes(), str(file), "exec")
        exec(code, module.__dict__)  # noqa: S102 - the user asked for this file
    except SyntaxError as error:
        raise ConfigError(f"syntax error: {error.msg}", where=f"{file}:{error.lineno}") from error
    except Exception as error:
        raise ConfigError(f"this file raised {error!r}", where=_place(error, file)) from error
    own = (each for each in vars(module).values() if inspect.isclass(each) and each.__module__ == module.__name__)
    return {each.__name__: each for each in own if callable(getattr(each, method, None))}


def _line(kind: type, method: str) -> int:
    found = getattr(kind, method, None)
    return int(found.__code__.co_firstlineno) if inspect.isfunction(found) else 0


def _place(error: Exception, file: Path) -> str:
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(file)]
    return f"{file}:{lines[-1]}" if lines else str(file)
