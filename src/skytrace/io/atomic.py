"""Folders that appear whole or not at all.

Content is written to a hidden sibling `.NAME.partial-PID`, flushed to disk and renamed. A process killed on the way
leaves only such a sibling, which the next one to write the same folder removes.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from skytrace.errors import InputError

MANIFEST = "manifest.json"
RUN_FORMAT = "skytrace run 1"
FLIGHTS_FORMAT = "skytrace flights 1"  # a folder with one run a flight

_OLD = "-old"
_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)


@contextmanager
def atomic_folder(destination: Path | str, *, replace_run: bool = True) -> Iterator[Path]:
    """A folder to write into, which becomes `destination` when the block ends without an exception.

    The destination may be absent, an empty folder or, with `replace_run`, an earlier run, which is then replaced
    whole. Anything else raises InputError before the block is entered and stays untouched.
    """
    # A link stays a link: the folder it leads to is the one replaced.
    destination = Path(os.path.realpath(destination))
    check_replaceable(destination, replace_run)
    partial = _partial_path(destination, os.getpid())
    try:
        try:
            destination.parent.mkdir(parents=True, exist_ok=True)
            _remove_leftovers(destination)
            partial.mkdir()
        except OSError as error:
            raise InputError(destination, f"cannot be written: {error.strerror or error}") from None
        yield partial
        _flush(partial)
        # What was there is looked at again: it may have changed while the content was made.
        check_replaceable(destination, replace_run)
        _exchange(partial, destination)
        _flush_entry(destination.parent)
    except OSError as error:
        if error.errno in _DISK_ERRORS:
            raise InputError(destination, f"cannot be written: {error.strerror}") from None
        raise
    finally:
        # After success the partial folder is gone, or holds the replaced run.
        _remove(partial)


@contextmanager
def atomic_file(destination: Path | str) -> Iterator[Path]:
    """A path of the same suffix to write at, which becomes `destination` when the block ends without an exception.

    Otherwise nothing is left but what was there before. Raises InputError where the destination cannot be written.
    """
    destination = Path(os.path.realpath(destination))
    check_file(destination)
    partial = destination.with_name(f".{destination.stem}.partial-{os.getpid()}{destination.suffix}")
    try:
        destination.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        _flush_entry(partial)
        os.replace(partial, destination)
        _flush_entry(destination.parent)
    except OSError as error:
        if error.errno in _DISK_ERRORS:
            raise InputError(destination, f"cannot be written: {error.strerror}") from None
        raise
    finally:
        partial.unlink(missing_ok=True)


def check_file(destination: Path | str) -> None:
    """Raise InputError, before any work is done, where `atomic_file` could not write."""
    destination = Path(os.path.realpath(destination))
    _check_parent(destination)
    if destination.is_dir():
        raise InputError(destination, "expected a file to write, got a folder")


def _remove(folder: Path) -> None:
    """Remove a folder to the end, also where Ctrl-C arrives while it is removed."""
    try:
        shutil.rmtree(folder, ignore_errors=True)
    except KeyboardInterrupt:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def is_run_folder(path: Path) -> bool:
    """Whether a folder holds the manifest of a finished run; other programs' manifest.json do not count."""
    return _format(path) == RUN_FORMAT


def is_flights_folder(path: Path) -> bool:
    """Whether a folder holds the runs of flights that were reconstructed together."""
    return _format(path) == FLIGHTS_FORMAT


def _format(path: Path) -> str | None:
    """The format that a folder's manifest states."""
    try:
        manifest = json.loads((path / MANIFEST).read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return manifest.get("format") if isinstance(manifest, dict) else None


def check_replaceable(destination: Path | str, replace_run: bool = True) -> None:
    """Raise InputError, before any work is done, where `atomic_folder` would refuse this destination."""
    destination = Path(os.path.realpath(destination))
    _check_parent(destination)
    if not os.path.lexists(destination):
        return
    if not destination.is_dir():
        raise InputError(destination, "is a file, expected a folder to write; choose another destination")
    if not any(destination.iterdir()):
        return
    if not replace_run:
        raise InputError(destination, "exists and is not empty; choose another destination or remove it")
    if not (is_run_folder(destination) or is_flights_folder(destination)):
        message = "exists and is not an earlier skytrace run, so it is not replaced; choose another destination"
        raise InputError(destination, message)


def _check_parent(destination: Path) -> None:
    parent = next(p for p in (*destination.parents, Path()) if os.path.lexists(p))
    if not parent.is_dir():
        raise InputError(destination, f"cannot be written: {parent} is a file, not a folder")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(destination, f"cannot be written: no permission to write in {parent}")


def _partial_path(destination: Path, pid: int, suffix: str = "") -> Path:
    return destination.parent / f".{destination.name}.partial-{pid}{suffix}"


def _remove_leftovers(destination: Path) -> None:
    prefix = f".{destination.name}.partial-"
    for entry in list(destination.parent.iterdir()):
        pid, _, suffix = entry.name.removeprefix(prefix).partition("-")
        # A killed process with this very id (usual in containers, where ids start over) left its folder too.
        if not entry.name.startswith(prefix) or not pid.isdecimal() or (int(pid) != os.getpid() and _alive(int(pid))):
            continue
        if suffix == _OLD[1:] and not destination.exists():
            os.rename(entry, destination)
        else:
            shutil.rmtree(entry, ignore_errors=True)


def _alive(pid: int) -> bool:
    if os.name == "nt":  # where signal 0 is not a question
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def _exchange(partial: Path, destination: Path) -> None:
    """Put `partial` in the place of `destination`, and a run that was there in the place of `partial`."""
    if not destination.exists() or not any(destination.iterdir()):
        os.replace(partial, destination)
        return
    if _exchange_in_one_step(partial, destination):
        return
    # Without the system call the destination is absent for a moment, never half-written. Killed in that moment, the
    # old run comes back when the folder is next written.
    aside = _partial_path(destination, os.getpid(), _OLD)
    os.rename(destination, aside)
    try:
        os.rename(partial, destination)
    except OSError:
        os.rename(aside, destination)
        raise
    shutil.rmtree(aside, ignore_errors=True)


def _exchange_in_one_step(a: Path, b: Path) -> bool:
    """Linux's renameat2; False where the system or the file system has none."""
    if not sys.platform.startswith("linux"):
        return False
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if renameat2 is None:
        return False
    return renameat2(_AT_FDCWD, os.fsencode(a), _AT_FDCWD, os.fsencode(b), _RENAME_EXCHANGE) == 0


def _flush(folder: Path) -> None:
    for root, _, files in os.walk(folder):
        for name in files:
            _flush_entry(Path(root) / name)
        _flush_entry(Path(root))


def _flush_entry(path: Path) -> None:
    if path.is_dir() and os.name == "nt":
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some file systems do not flush folders; the rename still keeps the order there.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EBADF):
            raise
    finally:
        os.close(descriptor)
