"""`skytrace report`: the page of a RUN with what is known of the truth, and pictures of it for papers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from skytrace.cli.evaluate import TruthFiles
from skytrace.cli.files import write_text
from skytrace.errors import InputError
from skytrace.evaluation.summary import Evaluation
from skytrace.io.atomic import atomic_file
from skytrace.io.run_folder import REPORT, read_run
from skytrace.io.text import read_text
from skytrace.io.truth import true_path
from skytrace.report import add_truth
from skytrace.report.container import take_apart


def report_command(run_folder: Path, output: Path | None, png: Path | None, truth: TruthFiles) -> None:
    """Read the page, add the truth, write, print where."""
    run = read_run(run_folder)
    source = run.path / REPORT
    page = read_text(source, "report of a run")
    if png is not None and png.exists() and not png.is_dir():
        raise InputError(png, "expected a folder for the pictures, got a file")
    files = truth.with_flight()
    if files.any:
        page = page_with_truth(source, page, files.judge(run), files)
    target = output or source
    if files.any or output is not None:
        write_text(target, page)
    print(target)
    if png is not None:
        for path in _write_pictures(source, page, png):
            print(path)


def page_with_truth(source: Path, page: str, evaluation: Evaluation, files: TruthFiles) -> str:
    """The page at `source` with what an evaluation by these files says."""
    truth = rate_hz = None
    if files.trajectory is not None:
        truth, rate_hz = true_path(files.trajectory, files.rate_hz)
    try:
        return add_truth(page, evaluation, truth, rate_hz)
    except ValueError as error:
        raise InputError(source, str(error)) from error


def _write_pictures(source: Path, page: str, folder: Path) -> Iterator[Path]:
    from skytrace.report.static import pictures

    try:
        files = pictures(take_apart(page).data)
    except ImportError as error:
        message = "the pictures are drawn with matplotlib, which is not installed: pip install 'skytrace[png]'"
        raise InputError("--png", message) from error
    except (ValueError, KeyError) as error:
        raise InputError(source, "not a report that this version of skytrace wrote: reconstruct it again") from error
    for name, content in files.items():
        with atomic_file(folder / name) as partial:
            partial.write_bytes(content)
        yield folder / name
