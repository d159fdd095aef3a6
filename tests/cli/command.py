"""The command line as its users have it: what a command returned, printed and left behind."""

from __future__ import annotations

import contextlib
import io
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from skytrace.cli import run

STAGE_LINE = re.compile(r"(read|clean|synchronise|initialise|grow|adjust|cover|write) +(?:(\d+)/(\d+) +)?\d+\.\d s")


@dataclass(frozen=True)
class Result:
    """What a command did."""

    code: int
    out: str
    err: str

    @property
    def message(self) -> str:
        """The one line on stderr that is not progress; fails where there is none or more, or a traceback."""
        lines = [line for line in self.err.splitlines() if not STAGE_LINE.fullmatch(line)]
        assert len(lines) == 1, self.err
        assert lines[0].startswith("skytrace: "), self.err
        return lines[0]


def skytrace(*arguments: object) -> Result:
    """Run a command in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run([str(a) for a in arguments])
    return Result(code, out.getvalue(), err.getvalue())


def python(*arguments: object, cwd: Path | None = None, environment: Mapping[str, str] | None = None) -> Result:
    """Run a Python of its own."""
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=cwd,
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=600,
    )
    return Result(done.returncode, done.stdout, done.stderr)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, hidden ones too, by its relative path; folders with their names and a slash."""
    return {
        str(path.relative_to(folder)) + ("/" if path.is_dir() else ""): b"" if path.is_dir() else path.read_bytes()
        for path in sorted(folder.rglob("*"))
    }
