"""A page taken apart again: what `whole_page` put together, for more to be told on it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from html import unescape
from typing import Any

_MAIN = ('<main id="main">\n', "</main>")
_DATA = ('<script type="application/json" id="report-data">', "</script>")
_TITLE = ("<h1>", "</h1>")


@dataclass(frozen=True, eq=False, slots=True)
class Parts:
    """A page's title, the HTML of its main element, and the data of its scripts."""

    title: str
    main: str
    data: dict[str, Any]


def take_apart(html: str) -> Parts:
    """The parts of a page. Raises ValueError where the text is not a page of skytrace."""
    title, main, data = (_between(html, *ends) for ends in (_TITLE, _MAIN, _DATA))
    try:
        values = json.loads(data)
    except json.JSONDecodeError as error:
        raise ValueError(f"the data of the page are not JSON: {error.msg}") from None
    if not isinstance(values, dict):
        raise ValueError("the data of the page are not an object")
    return Parts(unescape(title), main, values)


def _between(text: str, begin: str, end: str) -> str:
    _, found, rest = text.partition(begin)
    inside, closed, _ = rest.partition(end)
    if not (found and closed):
        raise ValueError(f"not a page of skytrace: no {begin.strip()}")
    return inside
