"""Message and service types of a ROS installation, found by name when they are needed."""

from __future__ import annotations

import importlib
import json
import os
import re
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

_NAME = re.compile(r"([A-Za-z]\w*)/(msg|srv|action)/([A-Za-z]\w*)", re.ASCII)
_OF_ACTIONS = {
    "_FeedbackMessage": "FeedbackMessage",
    "_SendGoal": "SendGoalService",
    "_GetResult": "GetResultService",
}
_LARGEST_FILE = 1 << 24  # generous: a description holds all nested types as well; not measured


class UnknownTypeError(Exception):
    """A type is not installed here."""


def service_type(name: str) -> Any:
    """Return the class of `pkg/srv/Name`, or of `pkg/action/Name_SendGoal` and `..._GetResult`."""
    found = message_type(name)
    if not hasattr(found, "Request"):
        raise UnknownTypeError(f"{name} is not a service")
    return found


@lru_cache(maxsize=1024)
def type_hash(name: str) -> str:
    """Return the RIHS01 hash of a type; empty if this distribution has none."""
    match = _NAME.fullmatch(name)
    if match is None:
        return ""
    package, kind, short = match.groups()
    if kind == "action":
        short = next((short[: -len(end)] for end in _OF_ACTIONS if short.endswith(end)), short)
    for prefix in [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]:
        file = Path(prefix, "share", package, kind, f"{short}.json")
        try:
            if not prefix or file.stat().st_size > _LARGEST_FILE:
                continue
            for each in json.loads(file.read_text(encoding="utf-8"))["type_hashes"]:
                if each["type_name"] == name:
                    return str(each["hash_string"])
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return ""


def message_type(name: str) -> Any:
    """Return the class of `pkg/msg/Name`, or of `pkg/action/Name_FeedbackMessage`."""
    match = _NAME.fullmatch(name)
    if match is None:
        raise UnknownTypeError(f"{name!r} is not the name of a ROS 2 type, such as std_msgs/msg/String")
    package, kind, short = match.groups()
    try:
        module = importlib.import_module(f"{package}.{kind}")
        if kind != "action":
            return getattr(module, short)
        for end, part in _OF_ACTIONS.items():
            if short.endswith(end):
                return getattr(getattr(module, short[: -len(end)]).Impl, part)
        raise UnknownTypeError(f"{name} is not a part of an action")
    except (ImportError, AttributeError) as error:
        raise UnknownTypeError(f"{name} is not installed ({error})") from error
