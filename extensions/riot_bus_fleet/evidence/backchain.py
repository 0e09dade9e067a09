"""`riot backchain`: from an internal field, or a finding, back to external topics, from logs alone (RIOT II-C)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

from riot_bus.backchain.graph import TopicGraph
from riot_bus.chain.base.logs import internal_name
from riot_bus.chain.base.systems import described
from riot_bus.chain.base.workspace import open_finding
from riot_bus.chain.unit.questions import named_fields
from riot_bus.chain.whole.topic_graphs import declared_graph, topics_named
from riot_bus.findings.backtrack import BacktrackRecord, EvidenceRecord
from riot_bus.log.foreign import learn_types
from riot_bus.log.reader import LogReader
from riot_bus.log.rosbag2 import files_of
from riot_bus.log.tables.plan import log_registry
from riot_bus.system.system_file import SystemFile, read_system
from riot_bus.trial.context import types_of
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.order import order_of
from riot_bus.vocabulary.selector import parse_selector
from riot_bus.vocabulary.trial import Progress
from riot_bus_fleet.evidence.backtrack import Backtracked, FieldEvidence, backtrack
from riot_bus_fleet.evidence.log_columns import LogColumns, read_pieces
from riot_bus_fleet.evidence.recorded_graph import RECORDED, RecordedComponents, joined


def backchain(
    logs: Sequence[Path],
    target: str,
    *,
    system: Path | None = None,
    externals: Sequence[str] = (),
    horizon: float = 2.0,
    seed: int = 0,
    progress: Progress | None = None,
) -> BacktrackRecord:
    """Find the paths from an internal field back to external topics in nominal logs; nothing is run.

    Args:
        target: A field such as `/map_updates:y`, or the folder of a finding: its relevant fields are used, and the
            result is saved there.
        system: Path of riot.toml; by default that of the finding, if the target is one.
        horizon: Longest delay of one step that is tested, in seconds.

    Raises:
        ConfigError: The target is not a field of the logs, or a log or riot.toml cannot be read.
    """
    begin = time.monotonic()
    folder = open_finding(Path(target))[0] if Path(target).is_dir() else None
    targets = [_field(target)] if folder is None else _fields_of(folder)
    file, registry = None, None
    if folder is not None:
        file, registry = described(folder, named=system)
    elif system is not None:
        registry = types_of(file := read_system(system))
    files = [file for log in logs for file in files_of(log)]
    columns = read_pieces(files, lambda reader: _registry(reader, registry), wanted=targets, progress=progress)
    _check(targets, columns)
    graph, outside, told, registry = _graph(files, columns, file, registry)
    for name in externals:
        topics = topics_named(name, columns.keys, registry)
        if not topics & columns.topics.keys():
            hint = did_you_mean(name, columns.topics)
            raise ConfigError(f"no topic {name!r} in these logs", where="--external", hint=hint)
        outside |= dict.fromkeys(sorted(topics), "--external")
    found = backtrack(
        columns.pieces,
        graph,
        targets,
        externals=outside,
        recorded=columns.topics,
        horizon=horizon,
        seed=seed,
        progress=progress,
    )
    record = _record(found, columns, files, told).model_copy(
        update={"seed": seed, "seconds": round(time.monotonic() - begin, 2)}
    )
    if folder is not None:
        record.save(folder)
    return record


def _field(target: str) -> str:
    selector = parse_selector(target)
    if selector.field is None or selector.where is not None:
        raise ConfigError(
            f"{target!r} is neither a field nor the folder of a finding",
            where="--to",
            hint="write TOPIC:FIELD, such as '/odom:twist.twist.linear.x'; `riot types LOG` lists the fields",
        )
    return f"{selector.topic}:{selector.field}"


def _fields_of(folder: Path) -> list[str]:
    found = sorted({internal_name(name) for name in named_fields(folder) if not order_of(name)})
    if not found:
        raise ConfigError("no field is relevant to this finding", where=str(folder), hint="name a field instead")
    return found


def _registry(reader: LogReader, registry: TypeRegistry | None) -> TypeRegistry:
    if registry is None:
        return log_registry(reader)
    learn_types(reader, registry)
    return registry


def _check(targets: Sequence[str], columns: LogColumns) -> None:
    known = {name for piece in columns.pieces for name in piece.values}
    for name in targets:
        topic = name.rpartition(":")[0]
        if topic not in columns.topics:
            hint = did_you_mean(topic, columns.topics)
            raise ConfigError(f"no topic {topic!r} in these logs", where="--to", hint=hint)
        if name not in known:
            hint = did_you_mean(name, [one for one in known if one.startswith(f"{topic}:")])
            raise ConfigError(f"no numeric field {name!r} in these logs", where="--to", hint=hint)


def _graph(
    files: Sequence[Path], columns: LogColumns, file: SystemFile | None, registry: TypeRegistry | None
) -> tuple[TopicGraph, dict[str, str], list[str], TypeRegistry]:
    """Return the graph of readers and writers, the external topics, the sources of both, and the registry."""
    recorded = RecordedComponents()
    for path in files:
        with LogReader(path) as reader:
            recorded.add(reader)
            registry = registry or log_registry(reader)
    assert registry is not None
    columns.notes += recorded.damaged
    told = [f"{RECORDED} of {recorded.logs} of {len(files)} logs"] if recorded.logs else []
    if file is None:
        return recorded.graph(), {}, told, registry
    declared = declared_graph(file, columns.keys, registry)
    outside: dict[str, str] = {}
    for name in file.external.topics:
        outside |= dict.fromkeys(sorted(topics_named(name, columns.keys, registry)), "riot.toml")
    return joined(declared, recorded.graph()), outside, [str(file.path), *told], registry


def _record(found: Backtracked, columns: LogColumns, files: Sequence[Path], told: Sequence[str]) -> BacktrackRecord:
    own = {one.name: getattr(found, one.name) for one in fields(found)}
    own["trees"] = [tree.as_json() for tree in found.trees]
    own["steps"] = [{**asdict(edge), "evidence": list(map(_evidence, edge.evidence))} for edge in found.edges]
    own["ranking"] = list(map(_evidence, found.ranking))
    read = {"messages": columns.messages, "looked_at": columns.looked_at, "notes": columns.notes}
    return BacktrackRecord.model_validate({**own, **read, "logs": list(map(str, files)), "told": list(told)})


def _evidence(one: FieldEvidence) -> EvidenceRecord:
    known = one.dependence
    tested: dict[str, object] = {"verdict": "not tested", "reason": one.reason}
    if known is not None:
        verdict = "follows" if known.found else "no evidence"
        tested = {**asdict(known), "verdict": verdict, "messages": one.rows, "logs": one.logs}
    return EvidenceRecord.model_validate({"source": one.source, "target": one.target, **tested})
