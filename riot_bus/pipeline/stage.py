"""One interceptor as a stage of a pipeline: its name, its conditions, and its errors."""

from __future__ import annotations

import traceback
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.pipeline.conditions import Selective, When
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import FrameType

    from riot_bus.pipeline.event import Event
    from riot_bus.types.registry import TypeRegistry

_ALL = When()


@dataclass(slots=True)
class InterceptorErrors:
    """How often one interceptor raised or was too slow, the first traceback, and the last place (`file:line`)."""

    count: int
    first: str
    place: str = ""


class Stage:
    """An interceptor with its conditions.

    Attributes:
        name: The interceptor's name, unique in its pipeline.
        message: The interceptor's method of this name.
        bypassed: Reason why the interceptor is no longer called; None as long as it is.
    """

    __slots__ = ("bypassed", "expressions", "interceptor", "message", "name", "target", "when")

    def __init__(self, given: object, taken: Counter[str]) -> None:
        interceptor = given.interceptor if isinstance(given, Selective) else given
        own = given.name if isinstance(given, Selective) else None
        name = str(own or getattr(interceptor, "name", None) or type(interceptor).__name__)
        message = getattr(interceptor, "message", None)
        if not callable(message):
            raise ConfigError(
                f"interceptor {name} has no method message(event)", hint="add one; it is all that it needs"
            )
        taken[name] += 1
        self.name = name if taken[name] == 1 else f"{name}#{taken[name]}"
        self.interceptor = interceptor
        self.message: Callable[[Event], None] = message
        self.when = given.when if isinstance(given, Selective) else _ALL
        self.target = self.when.target
        self.bypassed: str | None = None
        topics = getattr(interceptor, "topics", None)
        topics = [topics] if isinstance(topics, str) else topics
        self.expressions = None if topics is None else tuple(parse_selector(text).topic for text in topics)

    def for_key(self, key: str, registry: TypeRegistry) -> Callable[[Event], bool] | None:
        """Return a function that decides about the messages of one key; None if none of them is selected."""
        if self.expressions is not None and not any(registry.matches(text, key) for text in self.expressions):
            return None
        return self.when.for_key(key, registry)

    def hook(self, name: str) -> Callable[..., object] | None:
        """Return an optional method of the interceptor, such as `start`."""
        method = getattr(self.interceptor, name, None)
        return method if callable(method) else None

    def place(self, error: BaseException) -> str:
        """Return the last line of the interceptor's own file that an exception came from, as `file:line`."""
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if frame.filename == self._file()] or frames
        return f"{own[-1].filename}:{own[-1].lineno}" if own else ""

    def place_of_frame(self, frame: FrameType | None) -> str:
        """Return the last line of the interceptor's own file on a stack, as `file:line`."""
        while frame is not None:
            if frame.f_code.co_filename == self._file():
                return f"{frame.f_code.co_filename}:{frame.f_lineno}"
            frame = frame.f_back
        return ""

    def _file(self) -> str:
        code = getattr(self.message, "__code__", None)
        return code.co_filename if code is not None else ""


def stages_of(interceptors: Sequence[object]) -> tuple[Stage, ...]:
    """Return a stage for each interceptor; raises ConfigError for an object that is not an interceptor."""
    taken: Counter[str] = Counter()
    return tuple(Stage(each, taken) for each in interceptors)
