"""Everything that authors of plug-ins and extensions need: names that stay where they are.

Each is imported on first use, so `from riot_bus.plugin import Leaf` loads the types alone. docs/extending.md has an
example of each kind. All other modules of riot_bus may move from one version to the next, except the names of
`riot_bus` itself, which are for scripts.

An extension of riot itself may also fill hooks, entry points of the group `riot_bus.hooks`:

    access            try out who can do what at a fleet's router (`riot doctor --acl`)
    difference_from   compare delivered messages with a log (the fixture's `expect`)
    play_expecting    compare the answers to a played log with the expected ones (`riot play --expect`)
    transparency      compare a router with a plain one (`riot doctor --transparency`)
    workers           run trials elsewhere than on this machine (`--executor`)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from riot_bus.backchain.proposers import Proposer as Proposer
    from riot_bus.chain.base.logs import read_messages as read_messages
    from riot_bus.chain.base.workspace import StepRun as StepRun
    from riot_bus.chain.unit.forms import WrittenRule as WrittenRule
    from riot_bus.cli.help_groups import BUS as BUS
    from riot_bus.cli.help_groups import EXPLAIN as EXPLAIN
    from riot_bus.cli.help_groups import LOGS as LOGS
    from riot_bus.cli.help_groups import ROBOTS as ROBOTS
    from riot_bus.cli.help_groups import START as START
    from riot_bus.findings.records import Artefact as Artefact
    from riot_bus.findings.records import FindingRecord as FindingRecord
    from riot_bus.findings.records import RuleRecord as RuleRecord
    from riot_bus.findings.steps import ChainStep as ChainStep
    from riot_bus.findings.steps import StepOption as StepOption
    from riot_bus.interceptors.catalogue import build as build
    from riot_bus.monitors.model import TrialView as TrialView
    from riot_bus.pipeline.event import Event as Event
    from riot_bus.plugins import PluginKind as PluginKind
    from riot_bus.report.campaign_view import CampaignView as CampaignView
    from riot_bus.report.finding_view import FindingView as FindingView
    from riot_bus.report.format import clean as clean
    from riot_bus.testing.adapters import AdapterConformance as AdapterConformance
    from riot_bus.testing.faults import FaultConformance as FaultConformance
    from riot_bus.testing.interceptors import InterceptorBench as InterceptorBench
    from riot_bus.testing.interceptors import InterceptorConformance as InterceptorConformance
    from riot_bus.testing.monitors import MonitorConformance as MonitorConformance
    from riot_bus.testing.reports import ReportConformance as ReportConformance
    from riot_bus.testing.search import SearchConformance as SearchConformance
    from riot_bus.testing.steps import StepConformance as StepConformance
    from riot_bus.testing.types import TypeConformance as TypeConformance
    from riot_bus.types.capabilities import Announcement as Announcement
    from riot_bus.types.capabilities import HeardSystem as HeardSystem
    from riot_bus.types.capabilities import ListensToLinks as ListensToLinks
    from riot_bus.types.capabilities import ParsesTokens as ParsesTokens
    from riot_bus.types.json_type import JsonType as JsonType
    from riot_bus.types.model import Adapter as Adapter
    from riot_bus.types.model import Leaf as Leaf
    from riot_bus.types.model import MessageType as MessageType
    from riot_bus.types.model import TopicName as TopicName
    from riot_bus.types.model import why_opaque as why_opaque
    from riot_bus.types.model import wrap_integer as wrap_integer
    from riot_bus.types.registry import TypeRegistry as TypeRegistry
    from riot_bus.vocabulary.errors import ConfigError as ConfigError
    from riot_bus.vocabulary.errors import PayloadError as PayloadError
    from riot_bus.vocabulary.errors import RiotError as RiotError
    from riot_bus.vocabulary.errors import did_you_mean as did_you_mean
    from riot_bus.vocabulary.flags import Flag as Flag
    from riot_bus.vocabulary.message import Message as Message
    from riot_bus.vocabulary.trial import Violation as Violation

_MODULES = {
    "backchain.proposers": "Proposer",
    "chain.base.logs": "read_messages",
    "chain.base.workspace": "StepRun",
    "chain.unit.forms": "WrittenRule",
    "cli.help_groups": "BUS EXPLAIN LOGS ROBOTS START",
    "findings.records": "Artefact FindingRecord RuleRecord",
    "findings.steps": "ChainStep StepOption",
    "interceptors.catalogue": "build",
    "monitors.model": "TrialView",
    "pipeline.event": "Event",
    "plugins": "PluginKind",
    "report.campaign_view": "CampaignView",
    "report.finding_view": "FindingView",
    "report.format": "clean",
    "testing.adapters": "AdapterConformance",
    "testing.faults": "FaultConformance",
    "testing.interceptors": "InterceptorBench InterceptorConformance",
    "testing.monitors": "MonitorConformance",
    "testing.reports": "ReportConformance",
    "testing.search": "SearchConformance",
    "testing.steps": "StepConformance",
    "testing.types": "TypeConformance",
    "types.capabilities": "Announcement HeardSystem ListensToLinks ParsesTokens",
    "types.json_type": "JsonType",
    "types.model": "Adapter Leaf MessageType TopicName why_opaque wrap_integer",
    "types.registry": "TypeRegistry",
    "vocabulary.errors": "ConfigError PayloadError RiotError did_you_mean",
    "vocabulary.flags": "Flag",
    "vocabulary.message": "Message",
    "vocabulary.trial": "Violation",
}
_PLACES = {name: module for module, names in _MODULES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"riot_bus.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
