from __future__ import annotations

from pathlib import Path

from riot_bus.monitors.signature import crash_in, last_traceback

ROOT = Path("/srv/rover")


def traceback(*frames: str, error: str) -> str:
    return "\n".join(["Traceback (most recent call last):", *(f"  File {frame}\n    x()" for frame in frames), error])


OWN = '"/srv/rover/part.py", line 7, in place'
LIBRARY = '"/usr/lib/python3.11/json/decoder.py", line 3, in raw'
INSTALLED = '"/srv/rover/.venv/lib/site-packages/zenoh/x.py", line 9, in get'


def test_place_is_the_innermost_own_frame() -> None:
    crash = crash_in(1, "warning\n" + traceback(OWN, LIBRARY, INSTALLED, error="ValueError: no") + "\n", ROOT)
    assert crash is not None
    assert crash.place == "part.py:7 in place"
    assert crash.detail == "ValueError: no"


def test_different_exceptions_at_one_place_are_one_crash() -> None:
    first = crash_in(1, traceback(OWN, error="ValueError: -1"), ROOT)
    second = crash_in(1, traceback(OWN, error="MemoryError"), ROOT)
    assert first is not None
    assert second is not None
    assert first.place == second.place


def test_the_last_of_chained_exceptions_counts() -> None:
    chained = traceback(LIBRARY, error="KeyError: 1") + "\n\nDuring handling\n\n" + traceback(OWN, error="OSError: 2")
    assert last_traceback(chained) == traceback(OWN, error="OSError: 2")


def test_live_process_with_a_traceback_has_crashed() -> None:
    assert crash_in(None, traceback(OWN, error="ValueError: no"), ROOT) is not None
    assert crash_in(None, "all is well", ROOT) is None


def test_abort_while_ending_of_an_exception_is_that_exception() -> None:
    errors = traceback(OWN, error="ValueError: no") + "\nFATAL: exception not rethrown\n"
    crash = crash_in(-6, errors, ROOT)
    assert crash is not None
    assert (crash.place, crash.detail) == ("part.py:7 in place", "ValueError: no")
    long_ago = traceback(OWN, error="ValueError: no") + "\nline" * 9 + "\n"
    assert crash_in(-11, long_ago, ROOT) != crash
    segfault = crash_in(-11, long_ago, ROOT)
    assert segfault is not None
    assert segfault.place == "SIGSEGV"


def test_signals_and_native_last_words() -> None:
    def place(status: int, errors: str = "") -> str:
        crash = crash_in(status, errors, ROOT)
        assert crash is not None
        return crash.place

    assert place(-11) == "SIGSEGV"
    thrown = "terminate called after throwing an instance of 'std::bad_alloc'\n  what():  std::bad_alloc"
    assert place(-6, thrown) == "SIGABRT std::bad_alloc"
    assert place(-6, "thread 'main' panicked at src/main.rs:12:5:\nboom") == "SIGABRT src/main.rs:12"
    assert place(3) == "exit status 3"
    assert crash_in(0, "", ROOT) is None
