"""`skytrace calibrate`: a lens from pictures or videos of a chessboard or ChArUco board."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer

from skytrace.cli.files import write_text
from skytrace.cli.progress import shown
from skytrace.errors import InputError
from skytrace.geometry.projection import LensModel
from skytrace.io.atomic import check_file
from skytrace.io.calibration_writer import calibration_text
from skytrace.io.pictures import named_files
from skytrace.io.run_folder import json_text
from skytrace.pipeline.board_search import FoundBoards, find_boards
from skytrace.pipeline.calibrate import Calibration, calibrate, refuse
from skytrace.report import render_calibration_report

_ORDINARY = ("like other pictures", "no board found")  # not worth a line each
_LEAST_SQUARES, _MOST_SQUARES = 4, 100


def calibrate_command(
    inputs: Sequence[Path],
    output: Path,
    board: str | None,
    model: LensModel | None,
    report: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Find, fit, write, print. The report is written even where the lens is refused: it shows why."""
    squares = None if board is None else parse_board(board)
    check_outputs(output, report)
    found = _search(named_files(inputs), squares)
    for warning in found.warnings:
        print(f"skytrace: warning: {warning}", file=sys.stderr)
    size = None if squares is None else (max(squares) - 1, min(squares) - 1)
    calibration = calibrate(found, size, model, np.random.default_rng(seed))
    summary = calibration.summary()
    if report is not None:
        write_text(report, render_calibration_report(calibration_data(calibration), summary, name=output.stem))
    refuse(calibration)
    write_text(output, calibration_text(calibration.lens, calibration.frame_rate_hz, {"calibration": summary}))
    print(json_text(document(calibration), ascii_only=True) if as_json else describe(calibration, output, report))


def parse_board(text: str) -> tuple[int, int]:
    """Columns and rows of squares, such as 8x7. Raises typer.BadParameter, a usage error, for anything else."""
    match = re.fullmatch(r"\s*(\d+)\s*[xX]\s*(\d+)\s*", text)
    sides = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(_LEAST_SQUARES <= side <= _MOST_SQUARES for side in sides):
        message = f"expected the board's squares, {_LEAST_SQUARES}x{_LEAST_SQUARES} or more, such as 8x7; got {text!r}"
        raise typer.BadParameter(message, param_hint="--board")
    return sides


def check_outputs(output: Path, report: Path | None) -> None:
    """Raise InputError for files that cannot be written, or that `read_calibration` would not know."""
    if output.suffix.lower() != ".json":
        raise InputError(output, "expected a name that ends in .json: that is what calibrations are written as")
    for path in filter(None, (output, report)):
        check_file(path)
    if report is not None and report.resolve() == output.resolve():
        raise InputError(report, "is also the file for the calibration: give the report a name of its own")


def _search(files: Sequence[Path], squares: tuple[int, int] | None) -> FoundBoards:
    import time

    with shown() as display:
        display.open("boards", time.monotonic())
        try:
            return find_boards(files, squares, display.count)
        finally:
            display.close()


def document(calibration: Calibration) -> dict[str, Any]:
    """All figures, for machines."""
    lens, deviation = calibration.lens, calibration.lens.deviation
    assert deviation is not None
    return {
        "model": lens.model,
        "size_px": list(lens.size_px),
        "focal_px": lens.focal_px.tolist(),
        "principal_px": lens.principal_px.tolist(),
        "distortion": lens.distortion.tolist(),
        "deviation": {
            "focal": deviation.focal,
            "aspect": deviation.aspect,
            "principal_px": deviation.principal_px.tolist(),
            "distortion": deviation.distortion.tolist(),
        },
        **calibration.summary(),
    }


def describe(calibration: Calibration, output: Path, report: Path | None) -> str:
    """The result in a few lines for people."""
    lens, summary, deviation = calibration.lens, calibration.summary(), calibration.lens.deviation
    assert deviation is not None
    (fx, fy), (cx, cy), (sx, sy) = lens.focal_px, lens.principal_px, deviation.principal_px
    halves = summary["focal_halves_rms"]
    lines = [
        f"board        {summary['board']}",
        f"pictures     {summary['used']} used of {summary['boards_found']} that show it, {summary['pictures']} in all",
        f"lens         {lens.model}, {lens.size_px[0]} x {lens.size_px[1]} px",
        f"focal        {fx:.2f} x {fy:.2f} px +- {100 * deviation.focal:.2f} %",
        f"principal    {cx:.2f}, {cy:.2f} px +- {sx:.1f}, {sy:.1f} px",
        f"distortion   {', '.join(f'{k:.5f}' for k in lens.distortion)}",
        f"residuals    {summary['rms_px']:.3f} px RMS over {summary['corners_used']} corners",
    ]
    if halves is not None:
        lines.append(f"two halves   focal lengths {100 * halves:.2f} % apart (RMS over random splits)")
    lines.append(f"movement     halved or doubled moves the focal by {100 * summary['focal_motion_sensitivity']:.2f} %")
    not_used = summary["not_used"].items()
    lines += [f"not used     {name}: {why}" for name, why in not_used if why not in _ORDINARY]
    lines += [f"advice       {text}" for text in summary["advice"]]
    lines.append(f"written to   {output}")
    if report is not None:
        lines.append(f"report       {report}")
    return "\n".join(lines)


def calibration_data(calibration: Calibration) -> Any:
    """What the report draws."""
    from skytrace.report.calibration_page import DrawnView, LensPicture

    fit, fates = calibration.fit, calibration.fates()
    residual, rms = fit.residual_px, dict(zip([v.name for v in calibration.views], fit.rms_px.tolist(), strict=True))
    ends = np.append(fit.corners.start[1:], len(fit.corners))
    parts = {
        calibration.views[view].name: (fit.corners.xy_px[a:b], residual[a:b], float(np.degrees(tilt)))
        for view, a, b, tilt in zip(fit.views, fit.corners.start, ends, fit.state.tilt_rad, strict=True)
    }
    drawn = []
    for name, board in zip(calibration.found.names, calibration.found.boards, strict=True):
        xy, error, tilt = parts.get(name, (np.zeros((0, 2)) if board is None else board.xy_px, None, None))
        drawn.append(DrawnView(name, xy, error, fates[name], rms.get(name), tilt))
    return LensPicture(calibration.lens, tuple(drawn))
