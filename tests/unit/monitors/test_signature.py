from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.monitors.signature import (
    Crash,
    SourceFrame,
    crashes_in,
    fatal_thread,
    frames_in,
    traceback_of,
    tracebacks,
)

ROOT = Path("/srv/rover")


def traceback(*frames: str, error: str) -> str:
    return "\n".join(["Traceback (most recent call last):", *(f"  File {frame}\n    x()" for frame in frames), error])


OWN = '"/srv/rover/part.py", line 7, in place'
OTHER = '"/srv/rover/part.py", line 9, in elsewhere'
LIBRARY = '"/usr/lib/python3.11/json/decoder.py", line 3, in raw'
INSTALLED = '"/srv/rover/.venv/lib/site-packages/zenoh/x.py", line 9, in get'


def crash_in(status: int | None, errors: str, printed: str = "") -> Crash | None:
    return next(iter(crashes_in(status, errors, ROOT, printed)), None)


def test_place_is_the_innermost_own_frame() -> None:
    crash = crash_in(1, "warning\n" + traceback(OWN, LIBRARY, INSTALLED, error="ValueError: no") + "\n")
    assert crash == Crash("place: x()", "ValueError: no (part.py:7)")


@pytest.mark.parametrize(
    "frame", ['"/srv/rover/part.py", line 57, in place', '"/srv/rover/new/name.py", line 7, in place']
)
def test_a_shifted_line_and_a_renamed_file_are_the_same_place(frame: str) -> None:
    first, second = crash_in(1, traceback(OWN, error="E: 1")), crash_in(1, traceback(frame, error="E: 1"))
    assert first is not None
    assert second is not None
    assert first.place == second.place


def test_two_lines_of_a_function_are_two_places() -> None:
    errors = traceback(OWN, error="ValueError: 1")
    assert crash_in(1, errors) != crash_in(1, errors.replace("x()", "y()"))


def test_without_the_text_of_the_line_its_file_is_named() -> None:
    crash = crash_in(1, f"Traceback (most recent call last):\n  File {OWN}\nValueError: 1")
    assert crash is not None
    assert crash.place == "place of part.py"


def test_different_exceptions_at_one_place_are_one_crash() -> None:
    first = crash_in(1, traceback(OWN, error="ValueError: -1"))
    second = crash_in(1, traceback(OWN, error="MemoryError"))
    assert first is not None
    assert second is not None
    assert first.place == second.place


def test_the_last_of_chained_exceptions_counts() -> None:
    words = "\n\nDuring handling of the above exception, another exception occurred:\n\n"
    chained = traceback(LIBRARY, error="KeyError: 1") + words + traceback(OWN, error="OSError: 2")
    assert tracebacks(chained) == [traceback(OWN, error="OSError: 2")]


def test_all_places_of_a_trial_count_the_last_one_first() -> None:
    errors = "\n".join(traceback(frame, error="E: 1") for frame in (OWN, OTHER, OWN, OTHER))
    assert [crash.place for crash in crashes_in(None, errors, ROOT)] == ["elsewhere: x()", "place: x()"]


def test_tracebacks_count_on_stdout_too() -> None:
    assert crash_in(None, "", traceback(OWN, error="ValueError: no")) is not None


def test_live_process_with_a_traceback_has_crashed() -> None:
    assert crash_in(None, traceback(OWN, error="ValueError: no")) is not None
    assert crash_in(None, "all is well") is None


def test_abort_while_ending_of_an_exception_is_that_exception() -> None:
    errors = traceback(OWN, error="ValueError: no") + "\nFATAL: exception not rethrown\n"
    crash = crash_in(-6, errors)
    assert crash == Crash("place: x()", "ValueError: no (part.py:7)")
    long_ago = traceback(OWN, error="ValueError: no") + "\nline" * 9 + "\n"
    assert [each.place for each in crashes_in(-11, long_ago, ROOT)] == ["SIGSEGV", "place: x()"]


def test_signals_and_native_last_words() -> None:
    def place(status: int, errors: str = "") -> str:
        crash = crash_in(status, errors)
        assert crash is not None
        return crash.place

    assert place(-11) == "SIGSEGV"
    thrown = "terminate called after throwing an instance of 'std::bad_alloc'\n  what():  std::bad_alloc"
    assert place(-6, thrown) == "SIGABRT std::bad_alloc"
    assert place(-6, "thread 'main' panicked at src/main.rs:12:5:\nboom") == "SIGABRT src/main.rs"
    assert place(3) == "exit status 3"
    assert crash_in(0, "") is None
    assert crash_in(0, traceback(OWN, error="ValueError: no")) is None


FATAL = """Fatal Python error: Segmentation fault

Thread 0x00007f (most recent call first):
  File "/srv/rover/part.py", line 1 in worker

Current thread 0x00007f (most recent call first):
  File "/usr/lib/python3.11/ctypes/__init__.py", line 3 in call
  File "/srv/rover/part.py", line 12 in poke
  File "/srv/rover/part.py", line 20 in on_map

Extension modules: numpy (total: 1)
"""


def test_a_native_crash_has_the_functions_of_python_around_it() -> None:
    assert crash_in(-11, FATAL) == Crash("SIGSEGV in poke < on_map", "Fatal Python error: Segmentation fault")


ASAN = """==7==ERROR: AddressSanitizer: heap-buffer-overflow on address 0x602 at pc 0x55 bp 0x7f sp 0x7f
WRITE of size 4 at 0x602000000014 thread T0
    #0 0x55d in poke /srv/rover/core.c:12:3
SUMMARY: AddressSanitizer: heap-buffer-overflow /srv/rover/core.c:12:3 in poke
"""


LIBC = "/usr/lib/x86_64-linux-gnu/libc.so.6"
NODE = "/srv/rover/node"


@pytest.mark.parametrize(
    ("stack", "wanted"),
    [
        ([(NODE, "poke"), (NODE, "main"), (LIBC, "__libc_start_main")], "poke < main"),
        ([(LIBC, "memset"), (NODE, "poke"), (NODE, "main")], "poke < main"),
        ([(NODE, "deep"), (NODE, "deep"), (NODE, "deep"), (NODE, "main")], "deep < main"),
        ([(NODE, "a"), (NODE, "b"), (NODE, "c"), (NODE, "d")], "a < b < c"),
        ([(NODE, "_ZSt4sortIPiEvT_S1_"), (NODE, "_ZNSt6vectorIiE4pushEv"), (NODE, "poke")], "poke"),
        ([(NODE, "+0x1130"), (NODE, "main")], "node+0x1130 < main"),
        ([("", ""), (NODE, "poke")], "poke"),
        ([(LIBC, "abort"), ("/opt/ros/jazzy/lib/librclcpp.so", "spin"), ("/usr/bin/python3.11", "main")], "spin"),
        ([(LIBC, "abort"), ("/usr/lib/libcamera.so.0", "grab"), ("[vdso]", "")], "grab"),
        ([(LIBC, "abort"), (LIBC, "+0x271d0")], "abort < libc.so.6+0x271d0"),
    ],
)
def test_a_native_crash_has_the_functions_of_the_components_own_files(
    stack: list[tuple[str, str]], wanted: str
) -> None:
    (crash,) = crashes_in(-11, "", ROOT, stack=stack)
    assert crash.place == f"SIGSEGV in {wanted}"


def test_native_functions_come_before_those_of_python_around_them() -> None:
    library, python = "/srv/rover/scale.so", "/usr/lib/libpython3.11.so.1.0"
    (crash,) = crashes_in(-11, FATAL, ROOT, stack=[(LIBC, "memset"), (library, "scale"), (python, "PyObject_Call")])
    assert crash.place == "SIGSEGV in scale < poke < on_map"
    (crash,) = crashes_in(-11, FATAL, ROOT, stack=[(LIBC, "memset"), ("/usr/lib/libffi.so.8", "ffi_call")])
    assert crash.place == "SIGSEGV in poke < on_map"


def test_an_exception_that_ends_a_program_has_its_place() -> None:
    thrown = "terminate called after throwing an instance of 'std::bad_alloc'\n  what():  std::bad_alloc"
    (crash,) = crashes_in(-6, thrown, ROOT, stack=[(LIBC, "abort"), (NODE, "grow"), (NODE, "main")])
    assert crash.place == "SIGABRT std::bad_alloc in grow < main"


def test_what_a_sanitizer_reports_has_its_function_and_no_line() -> None:
    crash = crash_in(-6, ASAN)
    assert crash is not None
    assert crash.place == "AddressSanitizer heap-buffer-overflow in poke"
    shifted = crash_in(1, ASAN.replace("core.c:12:3", "core.c:62:3"))
    assert shifted is not None
    assert shifted.place == crash.place
    leak = crash_in(23, "SUMMARY: AddressSanitizer: 24 byte(s) leaked in 1 allocation(s).")
    assert leak is not None


def test_undefined_behaviour_counts_though_the_process_goes_on() -> None:
    text = "core.c:12:3: runtime error: signed integer overflow: 2147483647 + 1 cannot be represented in type 'int'"
    found = crashes_in(None, f"{text}\n{text.replace('12:3', '80:1').replace('2147483647', '99')}\n", ROOT)
    assert [crash.place for crash in found] == [
        "core.c: runtime error: signed integer overflow: N + N cannot be represented in type 'int'"
    ]
    assert crashes_in(0, text, ROOT) == found


def test_long_output_is_read_in_time() -> None:
    for part in ("a:1:1: runtime error", "SUMMARY: XSanitizer: ", " in ", "Traceback (most recent call last):\n"):
        crashes_in(1, part * 10_000, ROOT, part * 10_000)


def test_the_traceback_of_a_crash_is_found_by_its_place() -> None:
    crash, other = traceback(OWN, LIBRARY, error="ValueError: 1"), traceback(OTHER, error="ValueError: 2")
    (found,) = crashes_in(1, crash, ROOT)
    signature = f"crash in part: {found.place}"
    for errors, printed in ((f"{other}\n{crash}\n{other}\n", ""), (other, crash)):
        assert traceback_of(signature, errors, printed, ROOT) == crash
    assert traceback_of(signature, other, "", ROOT) == ""
    assert frames_in(crash)[0] == SourceFrame("/srv/rover/part.py", 7, "place")
    assert [frame.line for frame in frames_in(crash)] == [7, 3]


def test_the_stack_of_the_thread_in_which_a_signal_came() -> None:
    text = 'Fatal Python error: Aborted\n\nThread 0x1 (most recent call first):\n  File "/a.py", line 1 in wait\n\n'
    text += 'Current thread 0x2 (most recent call first):\n  File "/b.py", line 2 in call\n\nExtension modules: x\n'
    assert frames_in(fatal_thread(text)) == [SourceFrame("/b.py", 2, "call")]
    assert fatal_thread("Current thread 0x2 (most recent call first):") == ""


def launched(text: str, name: str = "planner-1") -> str:
    return "".join(f"[{name}] {line}\n" for line in text.splitlines())


def test_tracebacks_of_what_ros_launch_has_started() -> None:
    plain = traceback(OWN, LIBRARY, error="ValueError: no")
    printed = f"[INFO] [planner-1]: process started with pid [7]\n{launched(plain)}"
    assert crash_in(None, "", printed) == crash_in(1, plain) == Crash("place: x()", "ValueError: no (part.py:7)")
    assert traceback_of("crash in stack: place: x()", "", printed, ROOT) == plain


def test_deaths_that_ros_launch_tells() -> None:
    died = "[ERROR] [planner-1]: process has died [pid 7, exit code {}, cmd '/opt/planner --ros-args'].\n"
    assert crash_in(None, "", died.format(-11)) == Crash("SIGSEGV of planner", died.format(-11)[:59])
    places = [crash.place for crash in crashes_in(None, died.format(3), ROOT, died.format(-6))]
    assert places == ["SIGABRT of planner", "exit status 3 of planner"]
    plain = traceback(OWN, error="ValueError: no")
    assert [crash.place for crash in crashes_in(None, "", ROOT, launched(plain) + died.format(1))] == ["place: x()"]
    assert crash_in(0, "", died.format(-2)) is None


def test_a_crash_is_seen_however_often_others_come_after_it() -> None:
    errors = traceback(OTHER, error="E: 1") + "\n" + "\n".join(traceback(OWN, error=f"E: {n}") for n in range(50))
    assert [each.place for each in crashes_in(None, errors, ROOT)] == ["place: x()", "elsewhere: x()"]


def test_undefined_behaviour_is_seen_however_often_other_comes_before_it() -> None:
    one, other = "a.cpp:1:2: runtime error: null pointer\n", "b.cpp:1:2: runtime error: shift by 40\n"
    places = [each.place for each in crashes_in(None, one * 50 + other, ROOT)]
    assert places == ["a.cpp: runtime error: null pointer", "b.cpp: runtime error: shift by N"]
