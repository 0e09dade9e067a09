"""Robustness Inside-Out Testing (RIOT, Katz et al. 2020) on a message bus.

The names below are what a script needs; each is imported on first use, so that `import riot_bus` costs nothing. The
packages behind them are described in ARCHITECTURE.md, plug-ins in docs/extending.md.

Example:
    >>> import riot_bus
    >>> riot_bus.Message(0, "odom", b"{}").key
    'odom'
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from riot_bus.chain.base.workspace import Workspace
    from riot_bus.findings.steps import STEPS, ChainStep, find_step
    from riot_bus.inject.apply import inject_log
    from riot_bus.interceptors.parsing import from_text
    from riot_bus.log.engine.limits import LogLimits
    from riot_bus.log.reader import LogReader
    from riot_bus.log.tables.table import columns, iter_columns
    from riot_bus.log.writer import LogWriter
    from riot_bus.pipeline.runner import Pipeline
    from riot_bus.play.options import PlayOptions
    from riot_bus.play.service import PlayService
    from riot_bus.record.options import CaptureOptions
    from riot_bus.record.service import CaptureService
    from riot_bus.router.bus import Bus
    from riot_bus.types.registry import TypeRegistry, load_adapters
    from riot_bus.vocabulary.errors import ConfigError, InconclusiveError, PayloadError, RiotError
    from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal
    from riot_bus.vocabulary.message import Message, Qos
    from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict
    from riot_bus.zenoh.client import open_client

__version__ = "0.1.0"

# One name for each thing that scripts do: the modules and what each has of it.
_MODULES = {
    "chain.base.workspace": "Workspace",
    "findings.steps": "STEPS ChainStep find_step",
    "inject.apply": "inject_log",
    "interceptors.parsing": "from_text",
    "log.engine.limits": "LogLimits",
    "log.reader": "LogReader",
    "log.tables.table": "columns iter_columns",
    "log.writer": "LogWriter",
    "pipeline.runner": "Pipeline",
    "play.options": "PlayOptions",
    "play.service": "PlayService",
    "record.options": "CaptureOptions",
    "record.service": "CaptureService",
    "router.bus": "Bus",
    "types.registry": "TypeRegistry load_adapters",
    "vocabulary.errors": "ConfigError InconclusiveError PayloadError RiotError",
    "vocabulary.injection": "Curve Formula Injection Signal",
    "vocabulary.message": "Message Qos",
    "vocabulary.trial": "Outcome TestCase Verdict",
    "zenoh.client": "open_client",
}
_PLACES = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = [
    "STEPS",
    "Bus",
    "CaptureOptions",
    "CaptureService",
    "ChainStep",
    "ConfigError",
    "Curve",
    "Formula",
    "InconclusiveError",
    "Injection",
    "LogLimits",
    "LogReader",
    "LogWriter",
    "Message",
    "Outcome",
    "PayloadError",
    "Pipeline",
    "PlayOptions",
    "PlayService",
    "Qos",
    "RiotError",
    "Signal",
    "TestCase",
    "TypeRegistry",
    "Verdict",
    "Workspace",
    "columns",
    "find_step",
    "from_text",
    "inject_log",
    "iter_columns",
    "load_adapters",
    "open_client",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
