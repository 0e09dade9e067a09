"""Names for the files of a recording; no file is overwritten unless that is requested."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.control.log_paths import claim
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from riot_bus.record.options import CaptureOptions

_SUFFIX = ".mcap"


class Naming:
    """Names files one after another: `run.mcap`, `run-2.mcap` ..., or in a bag `run/run_0.mcap`, `run/run_1.mcap` ...

    Raises:
        ConfigError: The output exists already, or is not a name of a log.
    """

    def __init__(self, options: CaptureOptions) -> None:
        stem = f"{options.robot or 'riot'}-{time.strftime('%Y%m%d-%H%M%S')}"
        output = options.output
        if output is None:
            output = (options.folder or Path()) / (stem if options.bag else stem + _SUFFIX)
        elif not options.bag and output.is_dir():
            output = output / (stem + _SUFFIX)
        if not options.bag and output.suffix != _SUFFIX:
            hint = f"such as {output.name or 'run'}{_SUFFIX}; for a folder as of ros2 bag, take --bag"
            raise ConfigError(f"{str(output)!r} is not a name of a log", where="--output", hint=hint)
        self.bag = options.bag
        self.folder = output if options.bag else output.parent
        self.stem = output.name if options.bag else output.stem
        self._remote = self.folder if options.bag else options.folder or self.folder
        self._overwrite = options.overwrite
        self._number = 0

    def next(self, text: str | None = None) -> Path:
        """Create the next file, empty.

        Args:
            text: Path that a remote user asked for; None for the next name in turn.

        Raises:
            ConfigError: It cannot be created, or is refused.
        """
        if text is not None:
            if self.bag:
                hint = "leave out the path"
                raise ConfigError("the files of a bag are named automatically", where="record", hint=hint)
            return claim(self._remote, text, self.stem)
        if self.bag and not self._number:
            self._make_bag()
        for _ in range(100_000):  # one system call each: a folder full of such names is given up soon
            self._number += 1
            path = self.folder / self._name()
            first = self._number == 1
            if first and self._overwrite and not self.bag:
                return path
            try:
                os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600))
            except FileExistsError:
                if first:
                    self._number = 0
                    hint = "choose another name, or use --overwrite"
                    raise ConfigError(f"{path} exists already", where="--output", hint=hint) from None
            except OSError as error:
                self._number -= 1
                raise ConfigError(f"cannot write the log: {error.strerror}", where=str(path)) from None
            else:
                return path
        hint = "choose another name or folder"
        raise ConfigError(f"there are too many files {self.stem}-...", where=str(self.folder), hint=hint)

    def _name(self) -> str:
        if self.bag:
            return f"{self.stem}_{self._number - 1}{_SUFFIX}"
        return self.stem + (_SUFFIX if self._number == 1 else f"-{self._number}{_SUFFIX}")

    def _make_bag(self) -> None:
        try:
            self.folder.mkdir(exist_ok=self._overwrite)
            if self._overwrite:
                for path in [*self.folder.glob(f"*{_SUFFIX}"), *self.folder.glob("metadata.yaml")]:
                    path.unlink()
        except FileExistsError:
            hint = "choose another name, or take --overwrite"
            raise ConfigError(f"{self.folder} exists already", where="--output", hint=hint) from None
        except OSError as error:
            raise ConfigError(f"cannot write the bag: {error.strerror}", where=str(self.folder)) from None
