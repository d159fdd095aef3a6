"""What every page is made of: one file of HTML with its styles, data and scripts inside."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from string import Template
from typing import Any

from skytrace.report.words import count


def whole_page(
    title: str, kind: str, main: str, data: Mapping[str, Any], scripts: Sequence[str], styles: Sequence[str] = ()
) -> str:
    """A page that holds all it needs, plotly.js included: HTML `main`, and data for the scripts named.

    Scripts and styles are files of this package; those shared by all pages are added.
    """
    from plotly.offline import get_plotlyjs

    return filled(
        "shell.html",
        title=escape(title),
        kind=escape(kind),
        css="".join(_resource(name) for name in ("page.css", *styles)),
        main=main,
        data=_script_data(data),
        # Inside a script element only its end tag, in a string or not, has a meaning to the HTML parser.
        plotly=get_plotlyjs().replace("</script", "<\\/script"),
        scripts="".join(f"<script>\n{_resource(name)}</script>\n" for name in ("draw.js", *scripts)),
    )


def filled(name: str, **parts: str) -> str:
    """A file of this package with HTML in place of its $names."""
    return Template(_resource(name)).substitute(parts)


def _resource(name: str) -> str:
    return resources.files("skytrace.report").joinpath(name).read_text(encoding="utf-8")


def _script_data(data: Mapping[str, Any]) -> str:
    """JSON in which no text can end the script element around it."""
    text = json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c")


def options(values: Iterable[str], labels: Iterable[str]) -> str:
    """The options of a select element."""
    return "".join(f'<option value="{escape(v)}">{escape(t)}</option>\n' for v, t in zip(values, labels, strict=True))


def section(anchor: str, title: str, content: str, note: str = "") -> str:
    """A section of HTML content under a heading; empty without content."""
    if not content:
        return ""
    quiet = f'<p class="quiet">{escape(note)}</p>\n' if note else ""
    heading = f'<h2 id="{anchor}-title">{escape(title)}</h2>'
    return f'<section aria-labelledby="{anchor}-title">\n{heading}\n{content}\n{quiet}</section>\n'


def tiles(values: Iterable[tuple[str, str]]) -> str:
    """Names and values in large print."""
    return "".join(f"<div><dt>{escape(title)}</dt><dd>{escape(value)}</dd></div>\n" for title, value in values)


def warnings_card(warnings: Sequence[object]) -> str:
    """The warnings in a box of their own; empty without any."""
    if not warnings:
        return ""
    items = "".join(f"<li>{escape(str(warning))}</li>\n" for warning in warnings)
    title = count(len(warnings), "warning")
    return (
        '<section class="card warnings" aria-labelledby="warnings-title">\n'
        f'<h2 id="warnings-title">{title}</h2>\n<ul>\n{items}</ul>\n</section>\n'
    )
