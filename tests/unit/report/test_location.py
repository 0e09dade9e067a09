from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.findings.records import FindingRecord
from riot_bus.report.finding_view import FindingView, load
from riot_bus.report.location import SourcePlace, find_place, unit_place

SYSTEM = """\
[system]
name = "rover"
# [unit.planner] is below

[components.planner]
command = ["x"]

[unit.planner]
leave = []
"""
SIGNATURE = "crash in planner: window: return cells[x]"


def frame(file: object, line: int, function: str, source: str = "") -> str:
    return f'  File "{file}", line {line}, in {function}\n' + (f"    {source}\n" if source else "")


class Bench:
    """A repository with a riot.toml in a folder, and a finding with evidence."""

    def __init__(self, folder: Path) -> None:
        self.repository = folder / "repository"
        self.code = self.repository / "robots" / "rover"
        self.code.mkdir(parents=True)
        (self.repository / ".git").mkdir()
        (self.code / "riot.toml").write_text(SYSTEM)
        self.finding = folder / "out" / "findings" / "one"
        (self.finding / "evidence").mkdir(parents=True)

    def view(
        self, *, signature: str = SIGNATURE, monitor: str = "crash", system: object = None, **texts: str
    ) -> FindingView:
        for kind, text in texts.items():
            name = "backtrace.txt" if kind == "backtrace" else f"planner.{kind}.txt"
            (self.finding / "evidence" / name).write_text(text)
        FindingRecord(
            id="one",
            system="rover",
            system_file=str(system or self.code / "riot.toml"),
            unit="planner",
            component="planner",
            monitor=monitor,
            signature=signature,
        ).save(self.finding)
        return load(self.finding)

    def traceback(self, *, line: int = 35, source: str = "return cells[x]") -> str:
        return (
            "Traceback (most recent call last):\n"
            + frame(self.code / "planner.py", 97, "main", "serve()")
            + frame(self.code / "rover" / "workspace.py", line, "window", source)
            + frame("/usr/lib/python3.11/json/decoder.py", 3, "raw", "scan()")
            + "IndexError: no\n"
        )


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_a_crash_is_at_the_innermost_line_of_ones_own_code(bench: Bench) -> None:
    place = find_place(bench.view(stderr=f"warning\n{bench.traceback()}"))
    assert place == SourcePlace("robots/rover/rover/workspace.py", 35)
    assert str(place) == "robots/rover/rover/workspace.py:35"


def test_the_place_follows_the_line(bench: Bench) -> None:
    assert find_place(bench.view(stderr=bench.traceback(line=57))).line == 57


def test_of_several_tracebacks_that_of_the_signature_counts(bench: Bench) -> None:
    other = bench.traceback(line=9, source="something else")
    assert find_place(bench.view(stderr=other + bench.traceback() + other)).line == 35
    assert find_place(bench.view(stderr=other)) == SourcePlace("robots/rover/riot.toml", 8)


def test_a_traceback_on_stdout_counts_as_well(bench: Bench) -> None:
    assert find_place(bench.view(stdout=bench.traceback())).line == 35


def test_without_evidence_it_is_at_the_unit(bench: Bench) -> None:
    view = bench.view()
    assert find_place(view) == unit_place(view.finding) == SourcePlace("robots/rover/riot.toml", 8)


def test_a_unit_that_has_no_table_is_at_the_first_line(bench: Bench) -> None:
    view = bench.view()
    other = view.finding.model_copy(update={"unit": "mapper"})
    assert unit_place(other).line == 1
    (bench.code / "riot.toml").unlink()
    assert unit_place(view.finding).line == 1


def test_installed_packages_are_not_ones_own(bench: Bench) -> None:
    library = bench.code / ".venv" / "lib" / "site-packages" / "zenoh.py"
    text = "Traceback (most recent call last):\n" + frame(library, 3, "get", "x()") + "E: 1\n"
    view = bench.view(signature="crash in planner: get: x()", stderr=text)
    assert find_place(view).path == "robots/rover/riot.toml"


def test_code_of_the_repository_beside_riot_toml_is_ones_own(bench: Bench) -> None:
    text = "Traceback (most recent call last):\n" + frame(bench.repository / "lib" / "a.py", 3, "get", "x()") + "E: 1\n"
    assert find_place(bench.view(signature="crash in planner: get: x()", stderr=text)) == SourcePlace("lib/a.py", 3)


def test_links_are_followed(bench: Bench) -> None:
    (bench.repository / "src").mkdir()
    (bench.repository / "src" / "node.py").write_text("x()\n")
    (bench.code / "build").symlink_to(bench.repository / "src")
    text = "Traceback (most recent call last):\n" + frame(bench.code / "build" / "node.py", 1, "f", "x()") + "E: 1\n"
    assert find_place(bench.view(signature="crash in planner: f: x()", stderr=text)) == SourcePlace("src/node.py", 1)


def test_without_a_repository_paths_are_from_the_working_folder(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (bench.repository / ".git").rmdir()
    monkeypatch.chdir(bench.repository / "robots")
    assert find_place(bench.view()).path == "rover/riot.toml"
    monkeypatch.chdir(tmp_path / "out")
    assert find_place(bench.view()).path == "riot.toml"


SANITIZER = """\
==7==ERROR: AddressSanitizer: heap-buffer-overflow on address 0x602
READ of size 4 at 0x602 thread T0
    #0 0x4a in memcpy ../sanitizer/common.inc:827
    #1 0x55 in parse(char const*) {code}/src/parse.cpp:42:7
    #2 0x56 in main {code}/src/main.cpp:9
SUMMARY: AddressSanitizer: heap-buffer-overflow {code}/src/parse.cpp:42:7 in parse
"""
DEBUGGER = """\
#0  0x00007f in raise () from /lib/libc.so.6
#1  0x00005 in parse (text=0x0) at src/parse.cpp:43
#2  0x00006 in main () at /elsewhere/main.cpp:3
"""
FATAL = """\
Fatal Python error: Segmentation fault

Thread 0x1 (most recent call first):
  File "{code}/waiting.py", line 1 in wait

Current thread 0x2 (most recent call first):
  File "/usr/lib/python3.11/ctypes/x.py", line 7 in call
  File "{code}/node.py", line 62 in on_query

"""


@pytest.mark.parametrize(
    ("kind", "text", "path", "line"),
    [
        ("stderr", SANITIZER, "src/parse.cpp", 42),
        ("stderr", "{code}/src/parse.cpp:44:3: runtime error: shift\n", "src/parse.cpp", 44),
        ("stderr", "thread 'main' panicked at src/parse.cpp:45:5:\nno\n", "src/parse.cpp", 45),
        ("backtrace", DEBUGGER, "src/parse.cpp", 43),
        ("stderr", FATAL, "node.py", 62),
    ],
)
def test_native_stacks_are_understood(kind: str, text: str, path: str, line: int, bench: Bench) -> None:
    (bench.code / "src").mkdir()
    (bench.code / "src" / "parse.cpp").write_text("")
    view = bench.view(signature="crash in planner: SIGSEGV in parse", **{kind: text.format(code=bench.code)})
    assert find_place(view) == SourcePlace(f"robots/rover/{path}", line)


def test_a_relative_path_has_to_be_that_of_a_file(bench: Bench) -> None:
    view = bench.view(signature="crash in planner: SIGSEGV in parse", backtrace=DEBUGGER)
    assert find_place(view).path == "robots/rover/riot.toml"


def test_a_log_line_that_names_a_line_is_no_stack(bench: Bench) -> None:
    text = f"{bench.code}/config.py:12: warning: odd\n{bench.code}/config.py:13\n"
    assert find_place(bench.view(signature="crash in planner: exit status 3", stderr=text)).line == 8


def test_a_hang_is_where_its_thread_stands(bench: Bench) -> None:
    stacks = (
        f'Thread 0x1 (most recent call first):\n  File "{bench.code}/a.py", line 3 in rest\n\n'
        f'Current thread 0x2 (most recent call first):\n  File "/usr/lib/x.py", line 9 in sleep\n'
        f'  File "{bench.code}/a.py", line 18 in strokes\n  File "{bench.code}/a.py", line 41 in main\n'
    )
    view = bench.view(signature="hang of planner: in strokes", monitor="hang", stacks=stacks)
    assert find_place(view) == SourcePlace("robots/rover/a.py", 18)
    view = bench.view(signature="hang of planner", monitor="hang", stacks=stacks)
    assert find_place(view).path == "robots/rover/riot.toml"


def test_what_only_outputs_tell_is_at_the_unit(bench: Bench) -> None:
    view = bench.view(signature="range of /plan:x", monitor="range", stderr=bench.traceback())
    assert find_place(view).path == "robots/rover/riot.toml"


def test_names_of_components_lead_nowhere_else(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "secret.stderr.txt").write_text(bench.traceback())
    view = bench.view()
    finding = view.finding.model_copy(update={"component": "../../../../secret"})
    finding.save(bench.finding)
    assert find_place(load(bench.finding)).path == "robots/rover/riot.toml"


@pytest.mark.parametrize("system", ["/x\0/riot.toml", "/\ud800/riot.toml", "/" + "x" * 5000, "", "/\x1b[2J/riot.toml"])
def test_odd_paths_do_no_harm(system: str, bench: Bench) -> None:
    view = bench.view(stderr=bench.traceback())
    record = view.finding.model_copy(update={"system_file": system})
    for place in (unit_place(record), find_place(replace(view, finding=record))):
        assert place.line >= 1
        assert place.path.isprintable()
        assert len(place.path) <= 1000
