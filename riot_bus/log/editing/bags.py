"""Folders of ROS 2 bags: the files in them, and the metadata that rosbag2 needs of those that an edit writes.

From version 9 of its metadata on, rosbag2 writes QoS as names, before as numbers; the channels of a bag decide which.
Source: metadata_io and the MCAP plug-in of rosbag2.
"""

from __future__ import annotations

import json
import re
import textwrap
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from riot_bus.log.rosbag2 import BagFile, bag_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["FIELD", "Former", "former_of", "metadata_text", "record_of"]

FIELD = "serialized_metadata"
_MOST_BYTES = 1 << 26  # default limit of a metadata record (LogLimits.definitions)
_NAMES = re.compile(r"(?:history|reliability|durability|liveliness):\s*[A-Za-z]")
_DISTRO = re.compile(r'^ros_distro:\s*"?([\w.-]*)"?\s*$', re.MULTILINE)
_CUSTOM = re.compile(r"^custom_data:(?:[ \t]*\n(?:[ \t]+.*(?:\n|\Z))+|[^\n]*)", re.MULTILINE)
_HEAD = "rosbag2_bagfile_information:\n"


@dataclass(frozen=True, slots=True)
class Former:
    """The metadata of an input, apart from what is known of the output.

    Attributes:
        present: Whether the input has metadata.
        mapping: Mapping of its metadata record.
        distro: Name of the ROS distribution.
        custom: The user's own data, as YAML.
    """

    present: bool = False
    mapping: Mapping[str, str] = field(default_factory=dict)
    distro: str = ""
    custom: str = "custom_data: ~"


def former_of(mapping: Mapping[str, str]) -> Former:
    """Return the content of a metadata record `rosbag2`."""
    text = mapping.get(FIELD, "")[:_MOST_BYTES]
    if text.startswith(_HEAD):
        text = textwrap.dedent(text.removeprefix(_HEAD))
    distro, custom = _DISTRO.search(text), _CUSTOM.search(text)
    return Former(
        present=True,
        mapping=mapping,
        distro=distro[1] if distro else "",
        custom=custom[0].rstrip("\n") if custom else "custom_data: ~",
    )


def metadata_text(files: Sequence[BagFile], former: Former) -> str:
    """Return the text of `metadata.yaml`."""
    texts = list(dict.fromkeys(topic.qos for file in files for topic in file.topics))
    tokens = {qos: f"@{number}@" for number, qos in enumerate(texts)}
    marked = [replace(file, topics=[replace(topic, qos=tokens[topic.qos]) for topic in file.topics]) for file in files]
    text = bag_text(marked)
    named = any(_NAMES.search(qos) for qos in texts)
    for qos, token in tokens.items():
        text = text.replace(f" {json.dumps(token)}", _listed(qos) if named else f" {json.dumps(qos)}")
    text = re.sub(r"^  version: \d+$", "  version: 9", text, count=1, flags=re.MULTILINE) if named else text
    tail = textwrap.indent(f'{former.custom}\nros_distro: "{former.distro}"\n', "  ")
    return re.sub(r"^  custom_data: ~\n  ros_distro: .*\n", lambda match: tail, text, count=1, flags=re.MULTILINE)


def record_of(file: BagFile, former: Former) -> dict[str, str]:
    """Return the mapping of the metadata record `rosbag2` of one file."""
    text = metadata_text([file], former)
    return {**former.mapping, FIELD: textwrap.dedent(text.removeprefix(_HEAD))}


def _listed(qos: str) -> str:
    return "\n" + textwrap.indent(qos.strip("\n"), " " * 10) if qos.strip() else " []"
