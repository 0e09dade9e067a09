"""Drafts of commands that start components, from running processes: with placeholders, without secrets; pure."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePath

from riot_bus.draft.model import MISSING, CommandDraft
from riot_bus.vocabulary.redaction import redacted

_LOCATOR = re.compile(
    r"(?:tcp|tls|wss?|quic|udp)/(?:\[[^\]\s]+\]|[^\s/:;,'\"\[\]#?]+):([0-9]{1,5})(?:[?#][^\s'\",\]]*)?"
)
_SECRET = re.compile(
    r"(?i)(?:^|[_-])pass(?:wd|phrase)?(?:$|[_-])|password|secret|token|credential|(?:api|access|private|auth)[_-]?key"
)
_SET = re.compile(
    r"""(?i)(?:password|passphrase|secret|token|credential|api_?key|private_key_(?:pem|base64))\w*["']?\s*[:=]"""
    r"""(?!\s*(?:null\b|none\b|""|'')?\s*[,}\n])\s*\S"""
)
_FILE = ("file", "path", "dir")
_SETTINGS = frozenset({".json", ".json5", ".yaml", ".yml", ".toml", ".ini", ".cfg", ".conf", ".config", ".xml"})
"""Suffixes of settings files that are copied with {endpoint} in them; programs are never changed."""
_OPTION = re.compile(r"--?([A-Za-z][\w-]*)(=.*)?", re.DOTALL)
_OF_A_DESK = re.compile(
    "COLORFGBG|COLORTERM|COLUMNS|DISPLAY|EDITOR|HISTFILE|HISTSIZE|HOSTNAME|INVOCATION_ID|JOURNAL_STREAM|LINES|LOGNAME|"
    "LS_COLORS|MAIL|MANPAGER|NOTIFY_SOCKET|OLDPWD|PAGER|PPID|PROMPT_COMMAND|PS1|PWD|SHELL|SHLVL|STY|TERM|USER|USERNAME|"
    "VISUAL|WINDOWID|_|(BASH|DBUS|GNOME|KDE|LESS|PYTEST|RIOT|SSH|SUDO|TERM|TMUX|XDG)_.*"
)
"""Variables of an interactive session, such as of a shell or a desktop."""
_MOST_VARIABLES, _LONGEST = 40, 2000  # variables are one line of riot.toml; the rest is named in a comment


@dataclass(frozen=True, slots=True)
class ProcessFacts:
    """Known facts about a process.

    Attributes:
        program: Path of the executed program; empty if unknown.
        files: Texts of the files that it was given and that name an endpoint to connect to, by path.
    """

    pid: int
    command: tuple[str, ...]
    cwd: str
    program: str = ""
    environment: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)


def unknown_command(why: str) -> CommandDraft:
    """Return the draft of an unknown command, with the reason why it is unknown."""
    return CommandDraft((MISSING,), missing=(f"its command, with {{endpoint}} where it is told to connect: {why}",))


def command_draft(
    process: ProcessFacts,
    *,
    ports: Collection[int],
    endpoints: Collection[str] = (),
    ours: Mapping[str, str],
    python: str,
    taken: dict[str, str] | None = None,
) -> CommandDraft:
    """Return a draft of the command that starts a process again so that it connects to riot's endpoint.

    The network of the process listens on `ports`, and on `endpoints` without a port, such as socket files. All
    components get the environment `ours` in any case. `taken` are the texts of files that other drafts name already, by
    name; those of this draft are added.
    """
    missing: list[str] = []
    files: dict[str, str] = {}
    taken = {} if taken is None else taken

    def put_endpoint(text: str) -> str:
        for endpoint in endpoints:
            text = text.replace(endpoint, "{endpoint}")
        return _LOCATOR.sub(lambda found: "{endpoint}" if int(found[1]) in ports else found[0], text)

    def put(text: str) -> str:
        head, equals, path = text.rpartition("=")
        content = process.files.get(os.path.normpath(os.path.join(process.cwd, path)))
        pure = PurePath(path)
        if content is None or pure.suffix not in _SETTINGS or redacted(content) != content or _SET.search(content):
            return put_endpoint(text)
        content = put_endpoint(content)
        names = (f"{pure.stem}.riot{number or ''}{pure.suffix}" for number in range(len(taken) + 1))
        name = next(name for name in names if taken.get(name, content) == content)
        files[name] = taken[name] = content
        return f"{head}{equals}{{file:{name}}}"

    words = _without_secrets([put(word) for word in process.command], missing)
    if process.program == python:
        words[0] = "{python}"
    env, hidden = _environment(process.environment, ours, put)
    if not any("{endpoint}" in text for text in (*words, *env.values(), *files.values())):
        missing.append(_where_to(process, words, ports))
        words.insert(0, MISSING)
    if others := sorted({found[0] for word in words for found in _LOCATOR.finditer(word)}):
        missing.append(f"it also names {', '.join(others)}: {{free_port}} is another port in each trial")
    if hidden:
        missing.append(f"its environment has {', '.join(hidden)}, too, which may be secret and is not written here")
    return CommandDraft(tuple(words), process.cwd, env, tuple(missing), process.pid, files)


def locators(text: str, ports: Collection[int]) -> list[tuple[int, str]]:
    """Return the endpoints in a text that have one of these ports, each with its line number from 1."""
    found = ((number, each) for number, line in enumerate(text.splitlines(), 1) for each in _LOCATOR.finditer(line))
    return [(number, each[0]) for number, each in found if int(each[1]) in ports]


def _where_to(process: ProcessFacts, words: Sequence[str], ports: Collection[int]) -> str:
    """Return what to fill in if it is unknown how the process gets its endpoint, and why it is unknown."""
    bare = next((word for word in words if any(word.endswith(f":{port}") for port in ports)), None)
    if process.files:
        path, text = next(iter(process.files.items()))
        number, said = locators(text, ports)[0]
        why = f"{path}:{number} says {redacted(said)}"
    elif bare is not None:
        why = f"{bare} has no protocol, and {{endpoint}} is such as tcp/127.0.0.1:7447"
    else:
        why = "neither its command nor its environment says so"
    return f"{{endpoint}} where it is told to connect, and take {MISSING} out: {why}"


def _without_secrets(command: Sequence[str], missing: list[str]) -> list[str]:
    """Return a command with `FILL_IN` in place of possible secrets, and add each of them to `missing`."""
    found, before = [], ""
    for word in command:
        option = _OPTION.fullmatch(word)
        named = option[1] if option and _SECRET.search(option[1]) and not option[1].endswith(_FILE) else ""
        with_value = option is not None and option[2] is not None
        shown = redacted(word)
        hidden = ""
        if before and option is None:
            word, hidden = MISSING, before
        elif named and with_value:
            word, hidden = f"{word.partition('=')[0]}={MISSING}", named
        elif shown != word:
            word, hidden = shown.replace("...", MISSING), shown
        if hidden:
            missing.append(f"what stands for {MISSING}, since it may be secret: {hidden}")
        before = "" if with_value else named
        found.append(word)
    return found


def _environment(
    process: Mapping[str, str], ours: Mapping[str, str], put: Callable[[str], str]
) -> tuple[dict[str, str], list[str]]:
    """Return the variables that are specific to a process, and the names of those left out as possible secrets."""
    env: dict[str, str] = {}
    hidden: list[str] = []
    for name, value in sorted(process.items()):
        text = put(value)
        usual = ours.get(name) == value or _OF_A_DESK.fullmatch(name)
        if usual and text == value:
            continue
        if _SECRET.search(name) or redacted(text) != text or len(text) > _LONGEST or len(env) >= _MOST_VARIABLES:
            hidden.append(name)
        else:
            env[name] = text
    return env, hidden[:_MOST_VARIABLES]
