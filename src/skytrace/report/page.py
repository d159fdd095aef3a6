"""The report page put together: texts, tables, figures, styles and scripts in one file."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np

from skytrace.io.run_folder import SUPPORT_S
from skytrace.model.reconstruction import Reconstruction
from skytrace.report.clock_figures import clock_figures
from skytrace.report.container import Parts
from skytrace.report.figures import (
    VIEWS,
    colour_choices,
    decimals_for,
    numbers,
    path_columns,
    projected_columns,
    resolution,
    scene_figure,
    time_range_s,
    timeline_figure,
)
from skytrace.report.lens_table import lens_table
from skytrace.report.picture import picture_from_world
from skytrace.report.residual_figures import residual_figures
from skytrace.report.samples import MAX_RESIDUALS, PathSamples, path_samples, sight_intervals
from skytrace.report.shell import filled, options, section, tiles, warnings_card, whole_page
from skytrace.report.sync_tables import clock_table, pair_table
from skytrace.report.tables import camera_ids, camera_table, definitions, dropped_table, observability_table
from skytrace.report.theme import camera_colour, themes
from skytrace.report.words import (
    NO_BREAK,
    count,
    cut_sentence,
    frame_sentences,
    number,
    pooled_median_px,
    seconds,
    summary_sentences,
    unit_of,
)


def render_report(
    reconstruction: Reconstruction,
    summary: Mapping[str, Any],
    *,
    name: str,
    versions: Mapping[str, Any],
    settings: Mapping[str, Any],
) -> str:
    """The report of a run: HTML text that holds all it needs, plotly.js included.

    `summary` is what summary.json holds; what it does not hold is left out of the page. The same input gives the same
    text. What is known of the truth is added by `truth.add_truth`.
    """
    path, unit = path_samples(reconstruction), unit_of(reconstruction)
    ids, choices = camera_ids(reconstruction, summary), colour_choices(path, unit)
    main = filled(
        "page.html",
        warnings=warnings_card(summary.get("warnings") or ()),
        summary=escape(" ".join(_found(reconstruction, summary, len(ids)))),
        frame=escape(" ".join(frame_sentences(reconstruction))),
        tiles=_tiles(reconstruction, len(ids), path, unit),
        colours=options([choice["key"] for choice in choices], [choice["label"] for choice in choices]),
        cameras=camera_table(reconstruction, summary, unit),
        camera_options=options(map(str, range(len(reconstruction.cameras))), reconstruction.cameras),
        dropped=section("lenses", "Lenses", lens_table(reconstruction, summary), _LENSES)
        + section("dropped", "What was dropped", dropped_table(reconstruction, summary), _DROPPED),
        details=_details(ids, summary, settings, versions),
    )
    data = _data(reconstruction, summary, path, choices, unit)
    return page_of(Parts(name, main, data))


def page_of(parts: Parts) -> str:
    """The report made of its parts."""
    return whole_page(parts.title, "skytrace report", parts.main, parts.data, ["page.js"])


_LENSES = (
    "Refined: the calibration with what the flight says of it. A pattern is the part of the residuals that comes back "
    "wherever the target does: the lens has another shape than its calibration can have."
)
_DROPPED = (
    "Dropped before the reconstruction: what cannot be the moving target. Set aside later: detections that were used "
    "with little weight because they contradict the estimate."
)


def _data(
    reconstruction: Reconstruction,
    summary: Mapping[str, Any],
    path: PathSamples,
    choices: list[dict[str, Any]],
    unit: str,
) -> dict[str, Any]:
    """What the page's script needs, in JSON's types."""
    picture = picture_from_world(reconstruction)
    range_s, cameras = time_range_s(reconstruction), []
    for index, (camera_id, camera) in enumerate(reconstruction.cameras.items()):
        colour, n = camera_colour(index), len(camera.residuals.frame)
        cameras.append(
            {
                "id": camera_id,
                "centre": [round(v, 6) for v in picture.apply(camera.camera_from_world.centre).tolist()],
                "seen": [numbers(interval, 1e-3) for interval in sight_intervals(camera)],
                "shown": min(n, MAX_RESIDUALS),
                "used": n,
                "figures": residual_figures(camera, colour, range_s),
                "projected": projected_columns(path, camera),
            }
        )
    return {
        "unit": unit,
        "decimals": decimals_for(100 * resolution(path.position)),
        "support": SUPPORT_S,
        "themes": themes(),
        "views": VIEWS,
        "path": path_columns(path),
        "colours": choices,
        "cameras": cameras,
        "picture": picture.rotation.tolist(),
        "scene": scene_figure(reconstruction, path, picture, unit),
        "clocks": clock_figures(reconstruction, summary),
        "timeline": timeline_figure(reconstruction, path, unit),
    }


def _tiles(reconstruction: Reconstruction, n_cameras: int, path: PathSamples, unit: str) -> str:
    trajectory = reconstruction.trajectory
    shown = [
        ("cameras registered", f"{len(reconstruction.cameras)} of {n_cameras}"),
        ("covered", f"{seconds(trajectory.covered_s)}, {count(len(trajectory.segments), 'segment')}"),
        ("median reprojection error", f"{number(pooled_median_px(reconstruction), 2)} px"),
    ]
    sigma = path.sigma[np.isfinite(path.sigma)]
    if len(sigma):
        low, high = np.percentile(path.position, [2, 98], axis=0)  # as the summary measures the extent
        extent = float(np.linalg.norm(high - low))
        share = f", {number(100 * float(np.median(sigma)) / extent, 2)}{NO_BREAK}% of the extent" if extent > 0 else ""
        shown.append(("median posterior deviation", f"{number(float(np.median(sigma)), 2)} {unit}{share}"))
    return tiles(shown)


def _found(reconstruction: Reconstruction, summary: Mapping[str, Any], n_cameras: int) -> list[str]:
    """What the run found, in a few sentences."""
    left_out = cut_sentence(summary.get("not_covered") or {})
    return [*summary_sentences(reconstruction, n_cameras), *([left_out] if left_out else [])]


def _details(
    ids: list[str], summary: Mapping[str, Any], settings: Mapping[str, Any], versions: Mapping[str, Any]
) -> str:
    timings = {f"{stage} [s]": value for stage, value in (summary.get("timings_s") or {}).items()}
    parts = [
        ("What the data determine", _determined(summary, ids)),
        ("Synchronisation", _synchronisation(summary.get("synchronisation") or {})),
        ("Adjustment", definitions(summary.get("adjustment") or {})),
        ("Computing time", definitions(timings)),
        ("Settings", definitions(settings)),
        ("Versions", definitions(versions)),
    ]
    return "".join(
        f'<details class="card"><summary><h2>{escape(title)}</h2></summary>\n{content}\n</details>\n'
        for title, content in parts
        if content
    )


def _determined(summary: Mapping[str, Any], ids: list[str]) -> str:
    words = summary.get("observability_words") or ()
    items = "".join(f"<li>{escape(str(sentence))}</li>\n" for sentence in words)
    listed = f"<ul>\n{items}</ul>\n" if items else ""
    return listed + observability_table(summary.get("observability") or {}, ids)


def _synchronisation(document: Mapping[str, Any]) -> str:
    content = clock_table(document, {}) + pair_table(document)
    return f'{content}\n<p class="quiet">{escape(_BEFORE)}</p>' if content else ""


_BEFORE = (
    "As found from the tracks of two cameras at a time, before positions were known; the clocks in the table of "
    "cameras are those after the adjustment of everything together."
)
