"""Sanitising of texts before they are stored or shown: no secrets, no control characters, no commands for builds."""

from __future__ import annotations

import os
import re

# Compiled at first use: every command imports this module, but few need the patterns.
_MARK = r"(?a:#|(?:password|private_key_base64|private_key_pem)=(?!@))"
_ENDPOINT = r"(?i:(?:^|[^\w.+-])(?:tcp|tls|quic|udp|ws|wss|unixsock-stream|unixpipe|serial|vsock)/)"
_SETTING = r"(?a:\w+=)"
_USER = r"(?i:(://|(?<![\w/.+-])(?:tcp|tls|quic|udp|wss?)/)[^\s/'\"@:#]*:[^\s/'\"#]*@)"
_BREAK = r"[\s'\"]"
_QUOTED = {quote: rf"(?s:(?:\\.|[^\\{quote}])*+)" for quote in "'\""}
_WORD = r"\S*"
_PUNCTUATION = ",:;)]"
_COMMANDS = r"(?:^|(?<=[\r\n]))[^\S\r\n]*:(?=:)", r"#(?=#\w*\[)"
_BUILDS = ("GITHUB_ACTIONS", "TF_BUILD", "TEAMCITY_VERSION")
"""Variables that tell what runs a build and obeys its output: GitHub and those like it, Azure Pipelines, TeamCity."""


def redacted(text: str) -> str:
    """Return a text in which no endpoint shows its configuration or a password.

    A quoted secret ends at the closing quote, any other at white space. Names of files (`password=@FILE`) are kept.

    Example:
        >>> redacted("nobody answers at tls/host:1#a=b;c=d: is it there?")
        'nobody answers at tls/host:1#...: is it there?'
    """
    if "@" in text:
        text = re.sub(_USER, r"\1...@", text)
    shown, done = [], 0
    mark_from = re.compile(_MARK).search
    while mark := mark_from(text, done):
        before = text[done : mark.start()]
        word = re.split(_BREAK, before)[-1]
        shown.append(before + mark[0])
        done = mark.end()
        if mark[0] != "#" or re.search(_ENDPOINT, word) or ("/" in word and re.compile(_SETTING).match(text, done)):
            quote = before[: len(before) - len(word)][-1:]
            done = _end(text, done, quote)
            shown.append("...")
    return "".join(shown) + text[done:]


def _end(text: str, start: int, quote: str) -> int:
    found = re.compile(_QUOTED.get(quote, _WORD)).match(text, start)
    secret = found.group() if found else ""
    return start + len(secret if quote in _QUOTED else secret.rstrip(_PUNCTUATION))


def escape_control_chars(text: object, *, keep: str = "") -> str:
    r"""Return text with escape sequences in place of characters that are not printable.

    Example:
        >>> escape_control_chars("a\x1b[31m")
        'a\\x1b[31m'
    """
    plain = str(text)
    if plain.isprintable():
        return plain
    return "".join(each if each.isprintable() or each in keep else _escaped(each) for each in plain)


def without_commands(text: str) -> str:
    """Return text that no build obeys: where one runs, U+200B is put into `::` at a line's start, and into `##[`.

    A document of JSON says the same afterwards: it has no such line, and an escape in place of the first `#`.
    """
    if not any(map(os.environ.get, _BUILDS)):
        return text
    line, anywhere = _COMMANDS
    text = re.sub(line, "\\g<0>\u200b", text)
    return re.sub(anywhere, r"\\u0023" if text[:1] in "{[" else "#\u200b", text)


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape", "surrogatepass").decode()
