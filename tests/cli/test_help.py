"""Help answers at once, and a mistyped command line says how to type it."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys

import pytest
import typer

from skytrace import __version__
from skytrace.cli.app import app

from .command import python, skytrace

HEAVY = ("numpy", "scipy", "numba", "plotly", "poselib", "msgspec", "yaml")
LIMIT_S = 0.5


def commands() -> list[tuple[str, ...]]:
    """The program, its groups and every command in them."""

    def below(command, path: tuple[str, ...]) -> list[tuple[str, ...]]:
        inner = getattr(command, "commands", {})
        return [path] + [found for name, sub in inner.items() for found in below(sub, (*path, name))]

    return below(typer.main.get_command(app), ())


def child_cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def test_the_commands_are_there() -> None:
    names = {" ".join(path) for path in commands()}
    assert {"", "reconstruct", "simulate", "evaluate", "demo", "import", "import mvus"} <= names


@pytest.mark.parametrize("path", commands(), ids=lambda path: " ".join(path) or "skytrace")
def test_help_answers_at_once(path: tuple[str, ...]) -> None:
    took_s = []
    for _ in range(3):
        before_s = child_cpu_s()
        done = subprocess.run([sys.executable, "-m", "skytrace", *path, "--help"], capture_output=True, text=True)
        took_s.append(child_cpu_s() - before_s)
        assert done.returncode == 0
        assert done.stderr == ""
        assert " ".join(("Usage: skytrace", *path)) in done.stdout
        if took_s[-1] < LIMIT_S:
            break
    assert min(took_s) < LIMIT_S


def test_nothing_heavy_is_imported_before_a_command_runs() -> None:
    code = (
        "import json, sys, skytrace.cli, skytrace.__main__\n"
        f"for path in {commands()!r}: skytrace.cli.run([*path, '--help'])\n"
        f"print(json.dumps([name for name in {HEAVY!r} if name in sys.modules]))"
    )
    result = python("-c", code)
    assert result.code == 0, result.err
    assert json.loads(result.out.splitlines()[-1]) == []


def test_version() -> None:
    result = skytrace("--version")
    assert (result.code, result.out, result.err) == (0, f"{__version__}\n", "")


def test_help_names_each_switch_once() -> None:
    result = skytrace("reconstruct", "--help")
    assert result.code == 0
    assert "no-no-" not in result.out
    assert "FLIGHT" in result.out
    assert skytrace("reconstruct", "f", "-o", "r", "--no-fix-focal").code == 2


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("--bogus", "--bogus"),
        ("bogus", "bogus"),
        ("reconstruct", "FLIGHT"),
        ("reconstruct f", "--output"),
        ("reconstruct f -o r --bogus", "--bogus"),
        ("sync f -o r extra", "extra"),
        ("reconstruct f -o r --motion-prior smooth", "jerk"),
        ("reconstruct f -o r --seed -1", "--seed"),
        ("reconstruct f -o r --seed x", "--seed"),
        ("simulate", "--output"),
        ("simulate -o f --cameras 1", "--cameras"),
        ("simulate -o f --cameras 13", "--cameras"),
        ("simulate -o f --noise -1", "--noise"),
        ("evaluate", "RUN"),
        ("evaluate r --rate 0", "--rate"),
        ("import", "command"),
        ("import bogus", "bogus"),
        ("import mvus", "CONFIG.json"),
    ],
)
def test_a_wrong_command_line_is_a_usage_error(line: str, named: str, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = skytrace(*line.split())
    assert result.code == 2
    assert result.out == ""
    assert result.err.startswith("Usage: skytrace")
    assert named in result.err
    assert "Traceback" not in result.err
    assert os.listdir(tmp_path) == []


def test_without_a_command_the_help_goes_to_stderr() -> None:
    result = skytrace()
    assert (result.code, result.out) == (2, "")
    assert "reconstruct" in result.err
    assert result.err.lstrip().startswith("Usage: skytrace")
