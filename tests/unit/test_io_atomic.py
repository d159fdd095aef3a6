"""Folders that appear whole or not at all, also when the writer is killed."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from skytrace.errors import InputError
from skytrace.io import atomic
from skytrace.io.atomic import RUN_FORMAT, atomic_folder, check_replaceable, is_run_folder

MANIFEST = json.dumps({"format": RUN_FORMAT})


def write(destination: Path, **files: str) -> None:
    with atomic_folder(destination) as folder:
        for name, text in files.items():
            (folder / name).write_text(text)
        (folder / "manifest.json").write_text(MANIFEST)


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if path.name != "manifest.json"}


def hidden(parent: Path) -> list[str]:
    return sorted(path.name for path in parent.iterdir() if path.name.startswith("."))


def dead_pid() -> int:
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


def test_a_new_folder_with_its_parents(tmp_path):
    destination = tmp_path / "a" / "b" / "run"
    with atomic_folder(destination) as folder:
        assert folder.parent == destination.parent
        assert folder.name == f".run.partial-{os.getpid()}"
        (folder / "sub").mkdir()
        (folder / "sub" / "x").write_text("1")
        assert not destination.exists()
    assert (destination / "sub" / "x").read_text() == "1"
    assert hidden(destination.parent) == []


def test_an_empty_folder_is_filled(tmp_path):
    (tmp_path / "run").mkdir()
    write(tmp_path / "run", x="1")
    assert contents(tmp_path / "run") == {"x": "1"}


@pytest.mark.parametrize("in_one_step", [True, False])
def test_an_earlier_run_is_replaced_whole(tmp_path, monkeypatch, in_one_step):
    if not in_one_step:
        monkeypatch.setattr(atomic, "_exchange_in_one_step", lambda a, b: False)
    write(tmp_path / "run", x="1", old="1")
    write(tmp_path / "run", x="2")
    assert contents(tmp_path / "run") == {"x": "2"}
    assert hidden(tmp_path) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the one-step exchange is Linux's")
def test_the_one_step_exchange_works_here(tmp_path):
    for name in "ab":
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    if not atomic._exchange_in_one_step(tmp_path / "a", tmp_path / "b"):
        pytest.skip("this file system cannot exchange two folders")
    assert (tmp_path / "a" / "b").exists()
    assert (tmp_path / "b" / "a").exists()


@pytest.mark.parametrize("manifest", [None, "", "{}", "[]", '{"format": "web app"}', '{"name": "site", "icons": []}'])
def test_anything_else_is_refused_before_the_work(tmp_path, manifest):
    run = tmp_path / "run"
    run.mkdir()
    (run / "thesis.tex").write_text("dear")
    if manifest is not None:
        (run / "manifest.json").write_text(manifest)
    assert not is_run_folder(run)
    with pytest.raises(InputError, match="not an earlier skytrace run"), atomic_folder(run):
        pytest.fail("the block must not be entered")
    with pytest.raises(InputError, match="not an earlier skytrace run"):
        check_replaceable(run)
    assert contents(run) == {"thesis.tex": "dear"}
    assert hidden(tmp_path) == []


def test_a_run_is_kept_where_replacing_is_not_asked_for(tmp_path):
    write(tmp_path / "run", x="1")
    with pytest.raises(InputError, match="not empty"), atomic_folder(tmp_path / "run", replace_run=False):
        pytest.fail("the block must not be entered")
    assert contents(tmp_path / "run") == {"x": "1"}


def test_what_appears_at_the_destination_meanwhile_is_not_replaced(tmp_path):
    def work() -> None:
        with atomic_folder(tmp_path / "run") as folder:
            (folder / "x").write_text("1")
            (tmp_path / "run").mkdir()
            (tmp_path / "run" / "theirs").write_text("2")

    with pytest.raises(InputError, match="not an earlier skytrace run"):
        work()
    assert contents(tmp_path / "run") == {"theirs": "2"}
    assert hidden(tmp_path) == []


def test_a_file_is_no_destination(tmp_path):
    (tmp_path / "run").write_text("x")
    with pytest.raises(InputError, match="is a file"):
        write(tmp_path / "run")
    with pytest.raises(InputError, match="cannot be written"):
        write(tmp_path / "run" / "below")


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "run").symlink_to(tmp_path / "disk")
    write(tmp_path / "run", x="1")
    write(tmp_path / "run", x="2")
    assert (tmp_path / "run").is_symlink()
    assert contents(tmp_path / "disk") == {"x": "2"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError("x"), SystemExit(2)])
@pytest.mark.parametrize("before", [True, False])
def test_an_exception_leaves_what_was_there(tmp_path, error, before):
    if before:
        write(tmp_path / "run", x="1")

    def work() -> None:
        with atomic_folder(tmp_path / "run") as folder:
            (folder / "x").write_text("2")
            raise error

    with pytest.raises(type(error) if isinstance(error, BaseException) else error):
        work()
    assert hidden(tmp_path) == []
    assert (tmp_path / "run").exists() == before
    assert not before or contents(tmp_path / "run") == {"x": "1"}


def test_a_full_disk_is_one_clear_message(tmp_path):
    def work() -> None:
        with atomic_folder(tmp_path / "run"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(InputError, match="cannot be written: No space left"):
        work()
    assert list(tmp_path.iterdir()) == []


def test_leftovers_of_dead_writers_are_removed_and_only_those(tmp_path):
    pid = dead_pid()
    kept = [
        f".run.partial-{os.getppid()}",
        f".runner.partial-{pid}",
        ".run.partial-x",
        f".run.partial-{pid}.txt",
        ".run",
    ]
    for name in [*kept, f".run.partial-{pid}", f".run.partial-{os.getpid()}"]:
        (tmp_path / name).mkdir()
        (tmp_path / name / "x").touch()
    write(tmp_path / "run")
    assert hidden(tmp_path) == sorted(kept)


def test_a_run_set_aside_by_a_killed_writer_comes_back(tmp_path):
    aside = tmp_path / f".run.partial-{dead_pid()}-old"
    write(tmp_path / "run", x="1")
    (tmp_path / "run").rename(aside)

    def work() -> None:
        with atomic_folder(tmp_path / "run"):
            raise ValueError

    with pytest.raises(ValueError):  # noqa: PT011
        work()
    assert contents(tmp_path / "run") == {"x": "1"}
    (tmp_path / "run").rename(aside)
    write(tmp_path / "run", x="2")
    assert contents(tmp_path / "run") == {"x": "2"}
    assert hidden(tmp_path) == []


KILLED = """
import os, signal, sys
from pathlib import Path
from skytrace.io import atomic
destination, moment = Path(sys.argv[1]), sys.argv[2]
def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)
if moment == "flush":
    atomic._flush = die
if moment == "exchange":
    atomic._exchange = die
if moment == "aside":
    atomic._exchange_in_one_step = lambda a, b: False
    rename = os.rename
    os.rename = lambda a, b: (rename(a, b), die())
if moment == "cleanup":
    atomic._flush_entry = lambda path: die() if path == destination.parent else None
with atomic.atomic_folder(destination) as folder:
    (folder / "x").write_text("2")
    if moment == "between files":
        die()
    (folder / "manifest.json").write_text(sys.argv[3])
"""


@pytest.mark.parametrize("moment", ["between files", "flush", "exchange", "aside", "cleanup"])
def test_a_killed_writer(tmp_path, moment):
    """The destination is the old run or the new one, or absent: never half of anything."""
    destination = tmp_path / "run"
    write(destination, x="1", only_old="1")
    command = [sys.executable, "-c", KILLED, str(destination), moment, MANIFEST]
    process = subprocess.run(command, check=False, capture_output=True, timeout=60)
    assert process.returncode == -9, process.stderr.decode()
    assert len(hidden(tmp_path)) >= 1
    if moment == "aside":
        assert not destination.exists()
    else:
        new = moment == "cleanup"
        assert contents(destination) == ({"x": "2"} if new else {"x": "1", "only_old": "1"})
        assert is_run_folder(destination)
    write(destination, x="3")
    assert contents(destination) == {"x": "3"}
    assert hidden(tmp_path) == []
