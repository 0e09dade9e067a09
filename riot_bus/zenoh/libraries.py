"""Copies of Zenoh's library in one process, each with its own threads.

All sessions of one copy share Tokio's receive threads, and so may deadlock: after 128 reads in a row, Tokio 1.53 defers
a task until its thread has nothing else to do, and no other thread may take it. If that thread then handles a link that
waits for the deferred task to make room, both wait until Zenoh closes their links. Routers in one process that are
linked to each other therefore come from different copies.

The types of different copies are incompatible: arguments of a session's methods need the types of its `library_of`.
"""

from __future__ import annotations

import base64
import hashlib
import importlib.util
import mmap
import os
import shutil
import sys
import threading
from contextlib import suppress
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.new_file import whole_file, write_whole
from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from types import ModuleType

    import zenoh

_NAME = "zenoh.zenoh"
_MODE = 0o500  # of a copy: nobody writes to it
_lock = threading.Lock()
_copies: list[ModuleType] = []
_idle: list[ModuleType] = []
_by_type: dict[type, ModuleType] = {}


def borrow() -> ModuleType:
    """Return a copy that is not in use, or load a new one; give it back once all its sessions are closed.

    Raises:
        EnvironmentFaultError: It cannot be loaded.
    """
    with _lock:
        if _idle:
            return _idle.pop()
        library = _load(len(_copies))
        _copies.append(library)
        return library


def give_back(library: ModuleType) -> None:
    """Make a copy available to others; its threads are kept."""
    with _lock:
        _idle.append(library)


def library_of(thing: object) -> Any:
    """Return the copy to which an object belongs: `zenoh` itself, unless it comes from a borrowed copy."""
    kind = type(thing)
    found = _by_type.get(kind)
    if found is None:
        import zenoh

        own = (each for each in list(_copies) if getattr(each, kind.__name__, None) is kind)
        found = _by_type[kind] = next(own, zenoh)
    return found


def moved(stamp: zenoh.Timestamp | None, library: Any) -> Any:
    """Return a timestamp as one of another copy, at most a nanosecond earlier because of limited precision."""
    if stamp is None or type(stamp) is library.Timestamp:
        return stamp
    time = stamp.get_time_as_ntp64()
    return library.Timestamp(library.NTP64(time.as_secs(), time.subsec_nanos()), bytes(stamp.get_id()))


def _load(number: int) -> ModuleType:
    import zenoh

    original = Path(sys.modules[_NAME].__file__ or "")
    try:
        return _loaded(_kept(original, number), zenoh)
    except (OSError, ImportError, RuntimeError):  # such as no home, or one from which nothing may be executed
        try:
            return _loaded(_in_memory(original), zenoh)
        except (OSError, ImportError, AttributeError) as error:
            text = f"Zenoh's library cannot be loaded once more: {error}"
            raise EnvironmentFaultError(text, hint="set XDG_CACHE_HOME to where libraries may be kept") from error


def _kept(original: Path, number: int) -> int:
    """Open a copy on disk, shared by processes; the loader treats files with the same inode as one library."""
    path, digest = _place(original, number), _digest(original)
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    file = _opened(path, digest)
    if file is None:  # there is none, or not as it should be, such as after a loss of power
        with whole_file(path, mode=_MODE) as temporary:
            shutil.copyfile(original, temporary)
        file = _opened(path, digest)
    if file is None:
        raise OSError(f"{path} is not what was installed")
    return file


def _place(original: Path, number: int) -> Path:
    home = os.environ.get("XDG_CACHE_HOME", "")
    folder = (Path(home) if home else Path.home() / ".cache") / "riot-bus"
    return folder / f"zenoh-{_build(original)}-{number}.so"


def _opened(path: Path, digest: str) -> int | None:
    """Open a copy; return None if there is none, or if it differs from the installed library.

    The library is loaded from this descriptor, so the file cannot be replaced. Its contents, which take 20 ms to check,
    are checked once: a note beside it records the state of the file for which they were right.

    Raises:
        PermissionError: Others may write to it.
    """
    try:
        file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    try:
        state = os.fstat(file)
        if any(each.st_uid != os.getuid() or each.st_mode & 0o022 for each in (state, path.parent.stat())):
            raise PermissionError(f"others may write to {path}")
        note = path.with_suffix(".checked")
        right = f"{digest} {state.st_dev} {state.st_ino} {state.st_size} {state.st_mtime_ns} {state.st_ctime_ns}"
        if _text(note) == right:
            return file
        if _hashed(file) == digest:
            with suppress(OSError):  # such as a folder that is read-only
                write_whole(note, right, mode=_MODE)
            return file
    except BaseException:
        os.close(file)
        raise
    os.close(file)
    return None


def _text(path: Path) -> str:
    """Return the text of a note; empty if there is none."""
    try:
        return path.read_text(encoding="utf-8")
    except (FileNotFoundError, UnicodeDecodeError):
        return ""


def _hashed(file: int) -> str:
    """Return a SHA-256 in the format of wheels; other threads run meanwhile."""
    if not os.fstat(file).st_size:
        return ""
    with mmap.mmap(file, 0, prot=mmap.PROT_READ) as data:
        return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).decode().rstrip("=")


def _build(original: Path) -> str:
    """Return an id of the build: the checksum from its wheel, otherwise the modification time of the file."""
    return (_recorded(original) or str(original.stat().st_mtime_ns))[:20]


def _digest(original: Path) -> str:
    """Return the checksum of the installed library: from its wheel, otherwise that of the file."""
    recorded = _recorded(original)
    if recorded:
        return recorded
    with original.open("rb") as file:
        return _hashed(file.fileno())


def _recorded(original: Path) -> str:
    """Return the checksum that the wheel gave; empty if there is none."""
    for record in original.parents[1].glob("eclipse_zenoh-*.dist-info/RECORD"):
        for line in record.read_text(encoding="utf-8").splitlines():
            name, _, rest = line.partition(",")
            if name == f"{original.parent.name}/{original.name}":
                return rest.partition(",")[0].removeprefix("sha256=")
    return ""


def _in_memory(original: Path) -> int:
    file = os.memfd_create("zenoh")
    with original.open("rb") as source:
        while os.sendfile(file, source.fileno(), None, 1 << 26):  # one call copies it, 33 MB
            pass
    return file


def _loaded(file: int, original: ModuleType) -> ModuleType:
    """Load a library from an open file, which stays open: the loader knows libraries by their path, too."""
    path = f"/proc/self/fd/{file}"
    before = {name: module for name, module in sys.modules.items() if name.partition(".")[0] == original.__name__}
    try:
        library = _executed(_NAME, path, ExtensionFileLoader(_NAME, path))
        extensions = Path(original.__file__ or "").with_name("ext.py")
        library.ext = _executed("zenoh.ext", str(extensions), None)  # type: ignore[attr-defined]
    finally:
        sys.modules.update(before)  # a library enters its parts there
    return library


def _executed(name: str, path: str, loader: ExtensionFileLoader | None) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path, loader=loader)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a module")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
