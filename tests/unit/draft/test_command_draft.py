from __future__ import annotations

from typing import Any

import pytest

from riot_bus.draft.command_draft import ProcessFacts, command_draft, locators, unknown_command
from riot_bus.draft.model import CommandDraft

PORT = 7447


def draft(
    *command: str, taken: dict[str, str] | None = None, endpoints: tuple[str, ...] = (), **facts: Any
) -> CommandDraft:
    process = ProcessFacts(5, command, "/srv", **facts)
    ours = {"PATH": "/bin", "LANG": "C", "SAME": "tcp/h:7447"}
    return command_draft(process, ports={PORT}, endpoints=endpoints, ours=ours, python="/v/bin/python", taken=taken)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["p", "-e", "tcp/127.0.0.1:7447"], ("p", "-e", "{endpoint}")),
        (["p", "--connect=tcp/localhost:7447"], ("p", "--connect={endpoint}")),
        (["p", "tcp/[::1]:7447,tls/h.x:7447#root_ca_certificate=a.pem"], ("p", "{endpoint},{endpoint}")),
        (["p", '{connect:{endpoints:["tcp/h:7447"]}}'], ("p", '{connect:{endpoints:["{endpoint}"]}}')),
        (["p", "unixsock-stream//run/z.sock"], ("p", "{endpoint}")),
    ],
)
def test_the_endpoint_is_put_in_where_it_stands(words: list[str], expected: tuple[str, ...]) -> None:
    found = draft(*words, endpoints=("unixsock-stream//run/z.sock",))
    assert (found.command, found.missing, found.can_start) == (expected, (), True)
    assert (found.pid, found.cwd) == (5, "/srv")


def test_the_python_of_riot_is_put_in() -> None:
    assert draft("python3", "x.py", "tcp/h:7447", program="/v/bin/python").command[0] == "{python}"
    assert draft("python3", "x.py", "tcp/h:7447", program="/usr/bin/python3").command[0] == "python3"


def test_variables_that_others_do_not_have_are_kept_if_they_are_no_secrets() -> None:
    environment = {
        "PATH": "/bin", "LANG": "de", "SHLVL": "3", "XDG_SEAT": "x", "SAME": "tcp/h:7447", "CONNECT": "tcp/h:7447",
        "DB_PASSWORD": "x", "URL": "tls/u:pw@h:1", "AWS_SECRET_ACCESS_KEY": "x", "PASSENGERS": "4", "LONG": "x" * 3000,
    }  # fmt: skip
    found = draft("p", environment=environment)
    assert found.env == {"CONNECT": "{endpoint}", "LANG": "de", "PASSENGERS": "4", "SAME": "{endpoint}"}
    (hidden,) = found.missing
    assert "AWS_SECRET_ACCESS_KEY, DB_PASSWORD, LONG, URL, too" in hidden
    assert found.can_start
    many = draft("p", "tcp/h:7447", environment={f"V{number:03}": "x" for number in range(60)})
    assert len(many.env) == 40
    assert "V040" in many.missing[0]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["p", "--password", "pw", "tcp/h:7447"], ("p", "--password", "FILL_IN", "{endpoint}")),
        (["p", "--api-key=pw", "tcp/h:7447"], ("p", "--api-key=FILL_IN", "{endpoint}")),
        (["p", "--token", "--fast", "tcp/h:7447"], ("p", "--token", "--fast", "{endpoint}")),
        (["p", "--token-file", "t.txt", "tcp/h:7447"], ("p", "--token-file", "t.txt", "{endpoint}")),
        (["p", "http://me:pw@host/", "tcp/h:7447"], ("p", "http://FILL_IN@host/", "{endpoint}")),
        (["p", "tls/h:7447#password=pw"], ("p", "{endpoint}")),
    ],
)
def test_no_secret_of_a_command_is_written(words: list[str], expected: tuple[str, ...]) -> None:
    found = draft(*words)
    assert found.command == expected
    assert found.can_start is ("FILL_IN" not in " ".join(expected))
    assert bool(found.missing) is ("FILL_IN" in " ".join(expected))
    assert "pw" not in " ".join(found.missing)


@pytest.mark.parametrize(
    ("words", "files", "why"),
    [
        (["p"], {}, "neither its command nor its environment says so"),
        (["p", "127.0.0.1:7447"], {}, "127.0.0.1:7447 has no protocol"),
        (["p", "x.py"], {"/srv/x.py": 'a\nopen("tcp/h:7447")'}, "/srv/x.py:2 says tcp/h:7447"),
        (["p", "c.yaml"], {"/srv/c.yaml": "password=pw\ntcp/h:7447#a=b;c=d"}, "/srv/c.yaml:2 says tcp/h:7447#..."),
    ],
)
def test_what_does_not_say_where_it_connects_is_not_started(words: list[str], files: dict[str, str], why: str) -> None:
    found = draft(*words, files=files)
    assert found.command == ("FILL_IN", *words)
    assert not found.can_start
    (line,) = found.missing
    assert line.startswith("{endpoint} where it is told to connect, and take FILL_IN out: ")
    assert why in line


def test_settings_that_say_where_to_connect_are_copied() -> None:
    taken: dict[str, str] = {}
    text = 'mode: client\nconnect: ["tcp/localhost:7447"] # {x}'
    found = draft("p", "--conf=etc/z.yaml", files={"/srv/etc/z.yaml": text}, taken=taken)
    assert found.command == ("p", "--conf={file:z.riot.yaml}")
    assert found.files == taken == {"z.riot.yaml": 'mode: client\nconnect: ["{endpoint}"] # {x}'}
    same = draft("q", "etc/z.yaml", files={"/srv/etc/z.yaml": text}, taken=taken)
    other = draft("r", environment={"ZENOH_CONFIG": "/z.yaml"}, files={"/z.yaml": "tcp/h:7447"}, taken=taken)
    assert same.command == ("q", "{file:z.riot.yaml}")
    assert other.env == {"ZENOH_CONFIG": "{file:z.riot1.yaml}"}
    assert taken["z.riot1.yaml"] == "{endpoint}"
    assert all(each.can_start for each in (found, same, other))


@pytest.mark.parametrize(
    ("line", "copied"),
    [
        ('password: "pw",', False),
        ('"api_key": "pw"', False),
        ("token = pw", False),
        ("connect: tls/h:7447#password=pw", False),
        ("password: null,", True),
        ('"password": "",', True),
        ("user: me,", True),
    ],
)
def test_settings_with_a_secret_are_not_copied(line: str, copied: bool) -> None:
    found = draft("p", "z.json5", files={"/srv/z.json5": f"{{\n{line}\ntcp/h:7447 }}"})
    assert found.can_start is copied
    assert "pw" not in "".join([*found.files.values(), *found.missing])


def test_other_places_that_it_names_are_told() -> None:
    (line,) = draft("p", "-e", "tcp/h:7447", "-l", "tcp/0.0.0.0:7600").missing
    assert "also names tcp/0.0.0.0:7600" in line
    assert "{free_port}" in line


def test_lines_with_locators() -> None:
    assert locators("a\ntcp/h:1 tcp/h:2\n\nudp/[::]:2", {2}) == [(2, "tcp/h:2"), (4, "udp/[::]:2")]


def test_an_unknown_command_cannot_be_started() -> None:
    found = unknown_command("nobody tells")
    assert not found.can_start
    assert found.missing == ("its command, with {endpoint} where it is told to connect: nobody tells",)
