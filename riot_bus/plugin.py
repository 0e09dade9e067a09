"""Everything that authors of plug-ins and extensions need: names that stay where they are.

Each is imported on first use, so `from riot_bus.plugin import Leaf` loads the types alone. docs/extending.md has an
example of each kind. All other modules of riot_bus may move from one version to the next, except the names of
`riot_bus` itself, which are for scripts.

An extension of riot itself may also fill hooks, entry points of the group `riot_bus.hooks`:

    access            try out who can do what at a fleet's router (`riot doctor --acl`)
    backtrack_lines   show paths found in logs alone on a finding's page (`riot report`)
    difference_from   compare delivered messages with a log (the fixture's `expect`)
    play_expecting    compare the answers to a played log with the expected ones (`riot play --expect`)
    study             share a search as a study of optuna (`riot activate --study`)
    testkit           test plug-ins: the module with `InterceptorBench` and the names in `Conformance` below
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
    from riot_bus.events import RunEvent as RunEvent
    from riot_bus.findings.records import Artefact as Artefact
    from riot_bus.findings.records import FindingRecord as FindingRecord
    from riot_bus.findings.records import RuleRecord as RuleRecord
    from riot_bus.findings.steps import ChainStep as ChainStep
    from riot_bus.findings.steps import StepOption as StepOption
    from riot_bus.interceptors.catalogue import build as build
    from riot_bus.monitors.forging import with_message as with_message
    from riot_bus.monitors.forging import with_value as with_value
    from riot_bus.monitors.forging import without as without
    from riot_bus.monitors.model import Monitor as Monitor
    from riot_bus.monitors.model import TrialView as TrialView
    from riot_bus.pipeline.event import Event as Event
    from riot_bus.plugins import PluginKind as PluginKind
    from riot_bus.report.campaign_view import CampaignView as CampaignView
    from riot_bus.report.finding_view import FindingView as FindingView
    from riot_bus.report.format import clean as clean
    from riot_bus.report.formats import CampaignFormat as CampaignFormat
    from riot_bus.report.formats import ReportFormat as ReportFormat
    from riot_bus.types.capabilities import AllowsNonFinite as AllowsNonFinite
    from riot_bus.types.capabilities import Announcement as Announcement
    from riot_bus.types.capabilities import AnnouncesServers as AnnouncesServers
    from riot_bus.types.capabilities import ConvertsFiles as ConvertsFiles
    from riot_bus.types.capabilities import DescribesFields as DescribesFields
    from riot_bus.types.capabilities import DiscoversTypes as DiscoversTypes
    from riot_bus.types.capabilities import GathersFields as GathersFields
    from riot_bus.types.capabilities import HasServices as HasServices
    from riot_bus.types.capabilities import HeardSystem as HeardSystem
    from riot_bus.types.capabilities import Identity as Identity
    from riot_bus.types.capabilities import KnowsBrittleFields as KnowsBrittleFields
    from riot_bus.types.capabilities import ListensToLinks as ListensToLinks
    from riot_bus.types.capabilities import ListsParts as ListsParts
    from riot_bus.types.capabilities import ListsTypes as ListsTypes
    from riot_bus.types.capabilities import MessagePart as MessagePart
    from riot_bus.types.capabilities import Offer as Offer
    from riot_bus.types.capabilities import OmitsFields as OmitsFields
    from riot_bus.types.capabilities import ParameterRequest as ParameterRequest
    from riot_bus.types.capabilities import ParsesTokens as ParsesTokens
    from riot_bus.types.capabilities import PublishesAs as PublishesAs
    from riot_bus.types.capabilities import ReadsMetadata as ReadsMetadata
    from riot_bus.types.capabilities import ReadsTypesFromKeys as ReadsTypesFromKeys
    from riot_bus.types.capabilities import RecordedTopic as RecordedTopic
    from riot_bus.types.capabilities import SetsParameters as SetsParameters
    from riot_bus.types.capabilities import SimClock as SimClock
    from riot_bus.types.capabilities import Stamp as Stamp
    from riot_bus.types.capabilities import SuggestedValue as SuggestedValue
    from riot_bus.types.capabilities import SuggestsValues as SuggestsValues
    from riot_bus.types.capabilities import TakesFiles as TakesFiles
    from riot_bus.types.capabilities import Unpacker as Unpacker
    from riot_bus.types.json_type import JsonType as JsonType
    from riot_bus.types.model import Adapter as Adapter
    from riot_bus.types.model import Leaf as Leaf
    from riot_bus.types.model import MessageType as MessageType
    from riot_bus.types.model import Schema as Schema
    from riot_bus.types.model import TopicName as TopicName
    from riot_bus.types.model import TypeSource as TypeSource
    from riot_bus.types.model import why_opaque as why_opaque
    from riot_bus.types.model import wrap_integer as wrap_integer
    from riot_bus.types.registry import TypeRegistry as TypeRegistry
    from riot_bus.vocabulary.elements import Elements as Elements
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
    "events": "RunEvent",
    "findings.records": "Artefact FindingRecord RuleRecord",
    "findings.steps": "ChainStep StepOption",
    "interceptors.catalogue": "build",
    "monitors.forging": "with_message with_value without",
    "monitors.model": "Monitor TrialView",
    "pipeline.event": "Event",
    "plugins": "PluginKind",
    "report.campaign_view": "CampaignView",
    "report.finding_view": "FindingView",
    "report.format": "clean",
    "report.formats": "CampaignFormat ReportFormat",
    "types.capabilities": (
        "AllowsNonFinite Announcement AnnouncesServers ConvertsFiles DescribesFields DiscoversTypes GathersFields "
        "HasServices HeardSystem Identity KnowsBrittleFields ListensToLinks ListsParts ListsTypes MessagePart Offer "
        "OmitsFields ParameterRequest ParsesTokens PublishesAs ReadsMetadata ReadsTypesFromKeys RecordedTopic "
        "SetsParameters SimClock Stamp SuggestedValue SuggestsValues TakesFiles Unpacker"
    ),
    "types.json_type": "JsonType",
    "types.model": "Adapter Leaf MessageType Schema TopicName TypeSource why_opaque wrap_integer",
    "types.registry": "TypeRegistry",
    "vocabulary.elements": "Elements",
    "vocabulary.errors": "ConfigError PayloadError RiotError did_you_mean",
    "vocabulary.flags": "Flag",
    "vocabulary.message": "Message",
    "vocabulary.trial": "Violation",
}
_TESTKIT = frozenset(
    f"{kind}Conformance"
    for kind in ("Adapter", "CampaignReport", "Fault", "Interceptor", "Monitor", "Report", "Search", "Step", "Type")
) | {"InterceptorBench"}
_PLACES = {name: module for module, names in _MODULES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name in _TESTKIT:
        from riot_bus.plugins import hook

        return getattr(hook("testkit", "riot_bus_testkit"), name)
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"riot_bus.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES, *_TESTKIT})
