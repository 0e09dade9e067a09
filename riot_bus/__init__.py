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
    from riot_bus.chain.workspace import Workspace
    from riot_bus.findings.steps import STEPS, ChainStep, find_step
    from riot_bus.inject.apply import inject_log
    from riot_bus.interceptors.parsing import from_text
    from riot_bus.log.editing.edit import edit
    from riot_bus.log.editing.options import EditOptions
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

# One name for each thing that scripts do, by what they do it with; the module that has it.
_MESSAGES = {"Message": "vocabulary.message", "Qos": "vocabulary.message"}
_LOGS = {
    "EditOptions": "log.editing.options",
    "LogReader": "log.reader",
    "LogWriter": "log.writer",
    "columns": "log.tables.table",
    "edit": "log.editing.edit",
    "iter_columns": "log.tables.table",
}
_TYPES = {"TypeRegistry": "types.registry", "load_adapters": "types.registry"}
_BUSES = {"Bus": "router.bus", "open_client": "zenoh.client"}
_INTERCEPTORS = {"Pipeline": "pipeline.runner", "from_text": "interceptors.parsing"}
_RECORDING = {
    "CaptureOptions": "record.options",
    "CaptureService": "record.service",
    "PlayOptions": "play.options",
    "PlayService": "play.service",
}
_FAULTS = {
    "Curve": "vocabulary.injection",
    "Formula": "vocabulary.injection",
    "Injection": "vocabulary.injection",
    "Signal": "vocabulary.injection",
    "inject_log": "inject.apply",
}
_CHAIN = {
    "STEPS": "findings.steps",
    "ChainStep": "findings.steps",
    "Outcome": "vocabulary.trial",
    "TestCase": "vocabulary.trial",
    "Verdict": "vocabulary.trial",
    "Workspace": "chain.workspace",
    "find_step": "findings.steps",
}
_ERRORS = {
    "ConfigError": "vocabulary.errors",
    "InconclusiveError": "vocabulary.errors",
    "PayloadError": "vocabulary.errors",
    "RiotError": "vocabulary.errors",
}
_PLACES = _MESSAGES | _LOGS | _TYPES | _BUSES | _INTERCEPTORS | _RECORDING | _FAULTS | _CHAIN | _ERRORS

__all__ = [
    "STEPS",
    "Bus",
    "CaptureOptions",
    "CaptureService",
    "ChainStep",
    "ConfigError",
    "Curve",
    "EditOptions",
    "Formula",
    "InconclusiveError",
    "Injection",
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
    "edit",
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
