"""All kinds of plug-ins."""

from __future__ import annotations

from riot_bus import plugins

KINDS = tuple(each for each in vars(plugins).values() if isinstance(each, plugins.PluginKind))
