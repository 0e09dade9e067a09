"""Errors that say what, where, which value, and what to do.

All derive from one root; each class has an exit code of the command line (`riot_bus.cli`).
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from riot_bus.vocabulary.redaction import redacted

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from importlib.machinery import ModuleSpec

INTERRUPTED = 130  # exit code that shells report for a process ended by SIGINT: 128 + 2


class RiotError(Exception):
    """Root of every error that riot_bus raises on purpose; secrets of endpoints are left out of its texts.

    Args:
        message: Description of the problem, with the offending value.
        where: Place of the problem (file:line, key, field path), if there is one.
        hint: Advice for the user.
    """

    exit_code = 2

    def __init__(self, message: str, *, where: str | None = None, hint: str | None = None) -> None:
        self.message = redacted(message)
        self.where = where and redacted(where)
        self.hint = hint and redacted(hint)
        super().__init__(self.message)

    def __str__(self) -> str:
        text = f"{self.where}: {self.message}" if self.where else self.message
        return f"{text}\n  hint: {self.hint}" if self.hint else text


class ConfigError(RiotError):
    """A file, option, plan or selector of the user is not usable: correct it and run again."""


@contextmanager
def located(where: str) -> Iterator[None]:
    """Say where in the user's text it is that this context finds wrong."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(error.message, where=where, hint=error.hint) from None


class MissingExtraError(ConfigError):
    """An optional dependency is not installed: install the extra named in the hint."""

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(f"the Python package {package!r} is not installed", hint=install_hint(extra))


def install_hint(extra: str) -> str:
    """Return how an extra is installed: not by name, which anybody could register on PyPI before riot_bus does."""
    return f"pip install '.[{extra}]' in a checkout, or 'FILE.whl[{extra}]': riot_bus is not on PyPI yet"


@contextmanager
def needs_extra(package: str, extra: str) -> Iterator[None]:
    """Say what to install if an import in this context fails.

    Raises:
        MissingExtraError: An import failed.
    """
    try:
        yield
    except ImportError:
        raise MissingExtraError(package, extra) from None


def require_package(module: str, extra: str, *, package: str = "") -> ModuleSpec:
    """Find an optional dependency without importing it.

    Args:
        module: Name by which the package is imported.
        extra: Extra of riot-bus that installs it.
        package: Name of the package, as pip knows it; empty if it is the module's.

    Raises:
        MissingExtraError: The package is not installed.
    """
    from importlib.util import find_spec

    with needs_extra(package or module, extra):  # `find_spec` imports the parents of a module
        if (spec := find_spec(module)) is not None:
            return spec
    raise MissingExtraError(package or module, extra)


class PayloadError(RiotError, ValueError):
    """A payload cannot be decoded as its type, or a field path does not exist in it."""


class DataLossError(RiotError):
    """The work was finished, but messages were lost or a log is damaged; the numbers are in the message."""

    exit_code = 3


class EnvironmentFaultError(RiotError):
    """The environment failed: a port is in use, a component does not start, a router is unreachable."""

    exit_code = 4


class InconclusiveError(RiotError):
    """The outcome is too flaky for a statement within the budget: raise the budget or look at the component."""

    exit_code = 5


class OutOfTimeError(RiotError):
    """The time budget ended before there was an answer: give more time, or run the same command again to continue."""

    exit_code = 5


def did_you_mean(word: str, known: Iterable[str]) -> str | None:
    """Return a hint that names the nearest known words, or lists a few of them.

    Args:
        word: Word that the user wrote.
        known: Words that would have been accepted.
    """
    from difflib import get_close_matches

    options = sorted(set(known))
    near = get_close_matches(word, options, n=3, cutoff=0.6)
    if near:
        return "did you mean " + " or ".join(repr(option) for option in near) + "?"
    if not options:
        return None
    shown = ", ".join(options[:12]) + (", ..." if len(options) > 12 else "")
    return f"known: {shown}"
