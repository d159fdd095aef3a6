"""Killed or interrupted, the program leaves no folder that looks finished, and the next time none of the rest."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pytest

from skytrace.io.atomic import atomic_folder

from .command import STAGE_LINE, contents, python, skytrace
from .conftest import Finished

# The command line, but writing stops after the second file until somebody ends it.
STALLED = """
import sys, time
from skytrace.io import run_folder

write = run_folder._write

def stall(path, text):
    write(path, text)
    if path.name == run_folder.CAMERAS:
        print("writing", flush=True)
        time.sleep(300)

run_folder._write = stall
from skytrace.__main__ import main
sys.exit(main())
"""


@contextlib.contextmanager
def stalled_in_writing(flight: Path, run: Path) -> Iterator[subprocess.Popen[str]]:
    """A `skytrace reconstruct` that has written two of its files."""
    arguments = [sys.executable, "-c", STALLED, "reconstruct", str(flight), "-o", str(run), "--seed", "5"]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "writing\n"
            partial = run.parent / f".{run.name}.partial-{process.pid}"
            assert set(contents(partial)) == {"trajectory.csv", "cameras.json"}
            yield process
        finally:
            process.kill()


def test_killed_while_writing(flight: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with stalled_in_writing(flight, run) as process:
        assert not run.exists()
        process.kill()
        process.communicate()
    assert not run.exists()
    assert skytrace("evaluate", run, "--flight", flight).code == 3

    # The next one to write the folder clears up.
    assert skytrace("reconstruct", flight, "-o", run).code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    old = contents(run)

    with stalled_in_writing(flight, run) as process:
        assert contents(run) == old
        process.kill()
        process.communicate()
    assert contents(run) == old
    assert skytrace("evaluate", run, "--flight", flight).code == 0


def test_interrupted_while_writing(flight: Path, tmp_path: Path) -> None:
    with stalled_in_writing(flight, tmp_path / "run") as process:
        process.send_signal(signal.SIGINT)
        out, err = process.communicate()
    assert (process.returncode, out) == (130, "")
    assert_interrupted(err)
    assert list(tmp_path.iterdir()) == []


def test_interrupted_at_work(finished: Finished, tmp_path: Path) -> None:
    run = tmp_path / "run"
    arguments = [sys.executable, "-m", "skytrace", "reconstruct", str(finished.flight), "-o", str(run)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        heard = b""
        while b"synchronise" not in heard:
            piece = os.read(process.stderr.fileno(), 4096)
            assert piece, heard.decode()
            heard += piece
        process.send_signal(signal.SIGINT)
        out, rest = process.communicate()
    assert (process.returncode, out) == (130, b"")
    assert_interrupted((heard + rest).decode())
    assert list(tmp_path.iterdir()) == []


def test_interrupted_while_clearing_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    remove = shutil.rmtree
    calls = []

    def interrupted(path: Path, ignore_errors: bool) -> None:
        calls.append(path)
        if len(calls) == 1:
            raise KeyboardInterrupt
        remove(path, ignore_errors=ignore_errors)

    def fail_half_way() -> None:
        with atomic_folder(tmp_path / "run") as folder:
            (folder / "half").touch()
            raise ValueError

    monkeypatch.setattr(shutil, "rmtree", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fail_half_way()
    assert len(calls) == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("wrapped", [False, True])
def test_an_interrupt_in_any_shape_is_said_once(wrapped: bool, tmp_path: Path, monkeypatch) -> None:
    """Extension modules report it as a SystemError; one that has another cause stays a bug with its traceback."""

    def interrupted(*arguments: object) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            if wrapped:
                raise SystemError("returned a result with an exception set") from error
            raise

    monkeypatch.setattr("skytrace.cli.reconstruct.reconstruct_command", interrupted)
    result = skytrace("reconstruct", tmp_path, "-o", tmp_path / "run")
    assert (result.code, result.out) == (130, "")
    assert "interrupted" in result.message


def test_a_bug_keeps_its_traceback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for error in (SystemError("a bug"), ValueError("a bug"), OSError("a bug")):
        monkeypatch.setattr("skytrace.cli.reconstruct.reconstruct_command", mock.Mock(side_effect=error))
        with pytest.raises(type(error), match="a bug"):
            skytrace("reconstruct", tmp_path, "-o", tmp_path / "run")


def assert_interrupted(err: str) -> None:
    """Below the stages, the last of which may not have counted yet, stands one line."""
    *stages, message = err.splitlines()
    assert message.startswith("skytrace: interrupted"), err
    assert all(STAGE_LINE.fullmatch(line) for line in stages[:-1]), err
    assert stages[-1].startswith(("synchronise ", "initialise ", "grow ", "adjust ", "write ")), err


SWALLOWED = """
import signal, sys, time
from skytrace import interrupt

source = '''
def callback():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        return "swallowed"
    return "not here"
'''
scope = {"signal": signal}
exec(compile(source, sys.argv[1], "exec"), scope)
interrupt.install()
try:
    said = scope["callback"]()
    print(said)
    time.sleep(0 if said == "swallowed" else 30)
except KeyboardInterrupt:
    print("heard")
"""


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("lib/site-packages/llvmlite/binding/executionengine.py", "not here\nheard\n"),
        ("lib/site-packages/numba/core/typing/typeof.py", "not here\nheard\n"),
        ("<frozen importlib._bootstrap>", "not here\nheard\n"),
        ("skytrace/estimation/grow.py", "swallowed\n"),
    ],
)
def test_an_interrupt_that_would_be_swallowed_waits(file: str, said: str) -> None:
    """Exceptions end in callbacks from C++ and in the import of extension modules; there Ctrl-C must come later."""
    begin = time.monotonic()
    result = python("-c", SWALLOWED, file)
    assert (result.code, result.out) == (0, said), result.err
    assert time.monotonic() - begin < 15


def test_an_ignored_interrupt_stays_ignored() -> None:
    """As under nohup, or in the background of a shell script."""
    code = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); from skytrace import interrupt; "
    code += "interrupt.install(); print(signal.getsignal(signal.SIGINT) == signal.SIG_IGN)"
    assert python("-c", code).out == "True\n"


def test_a_reader_that_has_seen_enough(finished: Finished) -> None:
    """`skytrace evaluate ... | head -1` ends without complaint."""
    arguments = [sys.executable, "-m", "skytrace", "evaluate", str(finished.run), "--flight", str(finished.flight)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""


def test_a_terminal_that_cannot_spell() -> None:
    code = (
        "import skytrace.cli; skytrace.cli.run = lambda arguments: print('süd') or 0\n"
        "from skytrace.__main__ import main; raise SystemExit(main())"
    )
    result = python("-c", code, environment={"PYTHONIOENCODING": "ascii"})
    assert (result.code, result.out, result.err) == (0, "s\\xfcd\n", "")
