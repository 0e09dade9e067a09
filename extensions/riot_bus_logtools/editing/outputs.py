"""Names the files of an edit: they get temporary names, and are renamed when all are complete."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Sequence

_NO_NAME = re.compile(r"[^\w.-]+", re.ASCII)
_LONGEST = 100  # file names have 255 bytes at most; stem and number need some of them
METADATA = "metadata.yaml"


class Outputs:
    """Gives files their names.

    Raises:
        ConfigError: The output is one of the inputs, exists already, or cannot be created.
    """

    def __init__(
        self,
        output: Path,
        *,
        folder: bool,
        splits: bool,
        inputs: Sequence[Path],
        force: bool,
        dry: bool = False,
    ) -> None:
        self._output = output
        self._folder = folder
        self._inputs = [os.stat(path) for path in inputs]
        self._force = force
        self._names: dict[str, Path] = {}
        self._place: Path | None = None
        if dry:
            return
        if folder or not splits:
            self._check(output)
        if folder:
            for path in sorted(output.iterdir()) if output.is_dir() else ():
                self._check_inside(path)
        self._place = self._make_place()

    def path(self, label: str | None) -> tuple[Path, str]:
        """Return where to write a file, and its final path.

        Args:
            label: Label that distinguishes it from the others; None if there are no others.

        Raises:
            ConfigError: Such a file exists.
        """
        assert self._place is not None
        stem = self._output.name if self._folder else self._output.stem
        if label is None:
            name = f"{stem}_0.mcap" if self._folder else self._output.name
        else:
            name = f"{stem}_{_NO_NAME.sub('_', label).strip('_')[:_LONGEST] or 'topic'}.mcap"
        taken, number = name, 1
        while taken in self._names:
            number += 1
            taken = name.removesuffix(".mcap") + f"-{number}.mcap"
        final = (self._output if self._folder else self._output.parent) / taken
        if label is not None:
            self._check(final)
        self._names[taken] = final
        return self._place / taken, str(final)

    def metadata(self, text: str) -> None:
        """Write the `metadata.yaml` of a bag; raises OSError."""
        assert self._place is not None
        (self._place / METADATA).write_text(text, encoding="utf-8")
        self._names[METADATA] = self._output / METADATA

    def commit(self) -> None:
        """Give all files their names.

        Raises:
            EnvironmentFaultError: The files cannot be written there.
            ConfigError: Such a file has been created in the meantime.
        """
        if self._place is None:
            return
        try:
            if self._folder:
                self._output.mkdir(parents=True, exist_ok=True)
                self._remove_former()
            for name, final in self._names.items():
                if not self._folder:
                    self._check(final)
                os.replace(self._place / name, final)
        except OSError as error:
            raise EnvironmentFaultError(f"cannot write: {error.strerror}", where=str(self._output)) from error
        self.discard()

    def discard(self) -> None:
        """Remove temporary files; safe to call twice."""
        if self._place is not None:
            shutil.rmtree(self._place, ignore_errors=True)
            self._place = None

    def _make_place(self) -> Path:
        parent = self._output.parent
        try:
            if self._folder:
                parent.mkdir(parents=True, exist_ok=True)
            return Path(tempfile.mkdtemp(prefix=f".{self._output.name[:_LONGEST]}.", suffix=".part", dir=parent))
        except OSError as error:
            raise ConfigError(f"cannot write there: {error.strerror}", where=str(self._output)) from error

    def _check(self, path: Path) -> None:
        try:
            there = os.stat(path)
        except FileNotFoundError:
            return
        except OSError as error:
            raise ConfigError(f"cannot write there: {error.strerror}", where=str(path)) from error
        self._check_other(path, there)
        if path.is_dir():
            if not self._folder or path != self._output:
                raise ConfigError("this is a folder", where=str(path), hint="name a file that ends in .mcap")
            if not self._force and any(path.iterdir()):
                raise ConfigError("this folder exists and is not empty", where=str(path), hint="--force replaces it")
        elif self._folder and path == self._output:
            raise ConfigError("this is a file", where=str(path), hint="end its name in .mcap, or name a folder")
        elif not self._force:
            raise ConfigError("this file exists", where=str(path), hint="--force replaces it")

    def _check_inside(self, path: Path) -> None:
        """Check that a file in the output folder is part of a bag, before the folder is replaced."""
        if path.name != METADATA and path.suffix != ".mcap":
            hint = "name a folder that does not exist"
            raise ConfigError(f"this folder holds other things than a bag: {path.name}", where=str(path), hint=hint)
        self._check_other(path, os.stat(path))

    def _check_other(self, path: Path, status: os.stat_result) -> None:
        """Raise ConfigError if a file is one of the inputs."""
        if any(os.path.samestat(status, each) for each in self._inputs):
            raise ConfigError("input and output are the same", where=str(path), hint="name another output")

    def _remove_former(self) -> None:
        for path in list(self._output.iterdir()):
            if path.name == METADATA or path.suffix == ".mcap":
                with suppress(FileNotFoundError):
                    path.unlink()
