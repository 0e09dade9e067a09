"""The command `riot`: turns options into calls, outcomes into exit codes, and errors into one clear message."""

from __future__ import annotations

import errno
import faulthandler
import gc
import io
import os
import stat
import sys
from importlib import import_module
from typing import TYPE_CHECKING

from riot_bus import plugins
from riot_bus.cli.fastpath import quick_start, warn
from riot_bus.findings.steps import STEPS
from riot_bus.vocabulary.errors import INTERRUPTED, EnvironmentFaultError, RiotError
from riot_bus.vocabulary.redaction import escape_control_chars, redacted, without_commands

if TYPE_CHECKING:
    import typer


_END_S = 30.0  # generous, not measured: what still runs then is taken to hang

COMMANDS = {
    "chain": ("test", "demo", *(step.name for step in STEPS[1:]), "analyze", "reproduce", "step"),
    "ci": ("ci",),
    "reports": ("report", "findings", "trials", "compare", "predict", "guard"),
    "logs": ("info", "types", "show"),
    "play": ("play",),
    "record": ("record",),
    "router": ("exec", "router"),
    "ctl": ("graph", "ctl"),
    "init": ("init",),
    "dictionaries": ("dict",),
    "doctor": ("doctor", "interceptors"),
}
"""The commands of each module of this package."""


def make_app(command: str | None = None) -> typer.Typer:
    """Return the command-line application; given a command, load only its module, which takes half the time.

    Commands of other packages are functions that add them to a `typer.Typer`, entry points `riot_bus.commands`.
    """
    import typer

    from riot_bus.cli.help_groups import GroupedCommands, options

    app = typer.Typer(
        name="riot",
        cls=GroupedCommands,
        help="Robustness Inside-Out Testing: find a fault deep inside one unit, explain it, and drive the outside "
        "until the whole system fails.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        add_completion=True,
    )
    app.callback()(options)
    if modules := [name for name, commands in COMMANDS.items() if command in commands]:
        add_commands(app, modules[0])
        return app
    others = plugins.COMMANDS.targets()
    if command not in others:
        for name in COMMANDS:
            add_commands(app, name)
    wanted = [command] if command in others else {place: name for name, place in others.items()}.values()
    for name in wanted:
        plugins.COMMANDS.load(name)(app)
    return app


def add_commands(app: typer.Typer, name: str) -> None:
    """Add the commands of a module of this package: by its function `register`, or the functions of their names."""
    module = import_module(f"riot_bus.cli.{name}")
    if hasattr(module, "register"):
        module.register(app)
    else:
        for command in COMMANDS[name]:
            app.command(command)(getattr(module, command))


def _redact_log() -> None:
    """Leave secrets and control characters out of what is logged, tracebacks included."""
    import logging

    class Redacting(logging.Formatter):
        def format(self, record: logging.LogRecord) -> str:
            return escape_control_chars(redacted(super().format(record)), keep="\n\t")

    if logging.lastResort is not None:
        logging.lastResort.setFormatter(Redacting())


def _command_free(stream: object) -> None:
    """Let no text that a stream writes be a command for what runs the build; bytes and files stay as they are."""
    if isinstance(stream, io.TextIOWrapper) and not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
        plain = stream.write
        stream.reconfigure(encoding="utf-8", errors="backslashreplace")  # else typer would go around the stream
        stream.write = lambda text: plain(without_commands(text))  # type: ignore[method-assign]


def run() -> None:
    """Entry point of the console scripts."""
    arguments = sys.argv[1:]
    if without_commands("##[") != "##[":
        _command_free(sys.stdout)
        _command_free(sys.stderr)
    gc.disable()  # nothing that is loaded is garbage: searching it takes 4 % of the start-up time
    try:
        if arguments and not arguments[0].startswith("-"):  # else it is a question about riot, and nothing is logged
            _redact_log()
        if not quick_start(arguments):
            app = make_app(arguments[0] if arguments else None)
            if arguments[:1] != ["--help"]:
                gc.enable()
            app(standalone_mode=True)
    except RiotError as error:
        warn("\n".join(map(escape_control_chars, f"riot: {error}".split("\n"))))
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        warn("riot: interrupted; run the same command again to go on")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise
        warn(f"riot: {escape_control_chars(str(error))}; make room and run the same command again to go on")
        sys.exit(EnvironmentFaultError.exit_code)
    finally:
        # Python waits for remaining threads, such as those of a user's interceptor; what hangs for so long ends.
        faulthandler.dump_traceback_later(_END_S, exit=True, file=2)
