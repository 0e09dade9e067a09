"""Test classes and benches for authors of plug-ins, which `riot_bus.plugin` has, too; each is imported on first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from riot_bus_testkit.adapters import AdapterConformance as AdapterConformance
    from riot_bus_testkit.faults import FaultConformance as FaultConformance
    from riot_bus_testkit.interceptors import InterceptorBench as InterceptorBench
    from riot_bus_testkit.interceptors import InterceptorConformance as InterceptorConformance
    from riot_bus_testkit.monitors import MonitorConformance as MonitorConformance
    from riot_bus_testkit.reports import CampaignReportConformance as CampaignReportConformance
    from riot_bus_testkit.reports import ReportConformance as ReportConformance
    from riot_bus_testkit.search import SearchConformance as SearchConformance
    from riot_bus_testkit.steps import StepConformance as StepConformance
    from riot_bus_testkit.types import TypeConformance as TypeConformance

_MODULES = {
    "AdapterConformance": "adapters",
    "FaultConformance": "faults",
    "InterceptorBench": "interceptors",
    "InterceptorConformance": "interceptors",
    "MonitorConformance": "monitors",
    "CampaignReportConformance": "reports",
    "ReportConformance": "reports",
    "SearchConformance": "search",
    "StepConformance": "steps",
    "TypeConformance": "types",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
