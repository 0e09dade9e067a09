"""Baselines and known hangs of units, kept in the output folder so that later commands need not measure them again."""

from __future__ import annotations

import hashlib
import json
import logging
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from riot_bus.new_file import write_whole
from riot_bus.pool.wire import pack_baseline, read_baseline
from riot_bus.trial.baseline import Baseline, probe_of
from riot_bus.trial.hangs import KnownHangs
from riot_bus.vocabulary.message import Message

_HANGS: TypeAdapter[tuple[str, KnownHangs]] = TypeAdapter(tuple[str, KnownHangs])
_LOG = logging.getLogger(__name__)
_MEASURED = 4
"""Version of the measurement; increase it when the measurement changes, so that old baselines are measured again."""
_MOST = 16 << 20
"""Largest size of a file in bytes: a rule for each number of each answer to a probe takes about 100."""


class KeptBaselines:
    """Baselines in a folder, each in a file that is bound to code, settings and nominal log."""

    def __init__(self, folder: Path, fingerprint: str) -> None:
        self._folder, self._fingerprint = folder, fingerprint

    def get(self, unit: str, where: str, log: Sequence[Message], measure: Callable[[], Baseline]) -> Baseline:
        """Return the kept baseline, or measure one, and keep it if its trials have passed."""
        path, key = self._path(unit, where), self._key(unit, where, log)
        found = self._read(path, key)
        if found is not None:
            return replace(found, log=tuple(log), probe=probe_of(log))
        measured = measure()
        if measured.trials:
            _write(path, pack_baseline(key, replace(measured, log=(), probe=())))
        return measured

    def hangs(self, unit: str, log: Sequence[Message]) -> KnownHangs:
        """Return the known hangs of earlier trials of a unit alone, if they are of the same code, settings and log."""
        with suppress(OSError, ValidationError):
            bound, found = _HANGS.validate_json(self._path(unit, "alone").with_suffix(".hangs").read_bytes())
            if bound == self._key(unit, "alone", log):
                return found
        return KnownHangs()

    def keep_hangs(self, unit: str, log: Sequence[Message], known: KnownHangs) -> None:
        """Keep the known hangs of a unit for `hangs`; does nothing if they cannot be written."""
        data = _HANGS.dump_json((self._key(unit, "alone", log), known))
        with suppress(OSError):
            _write(self._path(unit, "alone").with_suffix(".hangs"), data)

    def _read(self, path: Path, key: str) -> Baseline | None:
        try:
            with path.open("rb") as stream:
                data = stream.read(_MOST + 1)
            if len(data) > _MOST:
                raise ValueError(f"it has more than {_MOST >> 20} MiB")
            bound, found = read_baseline(data)
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            _LOG.warning("nominal trials are measured anew: %s cannot be used: %s", path, str(error).splitlines()[0])
            return None
        if bound != key:
            _LOG.info("nominal trials are measured anew: %s is of other code, settings or another nominal log", path)
            return None
        return found

    def _path(self, unit: str, where: str) -> Path:
        name = f"{unit} {where}"
        plain = re.sub(r"[^A-Za-z0-9]+", "-", unit)[:40]
        return self._folder / f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:8]}.baseline"

    def _key(self, unit: str, where: str, log: Sequence[Message]) -> str:
        digest = hashlib.sha256(json.dumps([_MEASURED, self._fingerprint, unit, where]).encode())
        for message in log:
            digest.update(message.digest())
        return digest.hexdigest()


def _write(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, data)
