"""What a browser would find in a page, for tests."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from typing import Any

from skytrace.report import theme

VOID = {"meta", "link", "input", "br"}


class Page(HTMLParser):
    """Elements with their attributes, and the text inside each kind of element; fails where one is never closed."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text: dict[str, str] = {}
        self.feed(html)
        self.close()
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        for tag in set(self.open):
            self.text[tag] = self.text.get(tag, "") + data

    def values(self, attribute: str) -> list[str]:
        return [attrs[attribute] or "" for _, attrs in self.elements if attribute in attrs]

    def assert_references_resolve(self) -> None:
        """Whatever the page or its script looks for by its id is there, once."""
        ids = self.values("id")
        assert len(ids) == len(set(ids))
        for attribute in ("aria-labelledby", "for"):
            assert set(self.values(attribute)) <= set(ids)
        assert {link[1:] for link in self.values("href") if link.startswith("#")} <= set(ids)
        script = self.text["script"]
        for name in re.findall(r"byId\('([\w-]+)'\)", script[script.rindex("report-data") :]):
            assert name in ids, name

    def assert_asks_for_nothing(self) -> None:
        for attribute in ("src", "href", "action", "data", "poster"):
            for value in self.values(attribute):
                assert value.startswith(("#", "data:")), value
        assert "url(" not in self.text["style"]
        assert "@import" not in self.text["style"]
        policy = next(a["content"] for _, a in self.elements if a.get("http-equiv") == "Content-Security-Policy")
        assert policy is not None
        assert policy.startswith("default-src 'none'")
        assert "http" not in policy


def data_of(html: str) -> Any:
    """The data that the page holds for its script."""
    text = re.search(r'<script type="application/json" id="report-data">(.*?)</script>', html, re.DOTALL)
    assert text is not None

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text[1], parse_constant=refuse)


def assert_controls_are_named(html: str) -> None:
    """Every select and input stands inside a label."""
    body = html[: html.index('<script type="application/json"')]
    for control in re.findall(r"<(?:select|input)\b[^>]*>", body):
        before = body[: body.index(control)]
        assert before.rindex("<label") > before.rfind("</label>"), control


def coloured(value):
    """The value with a colour for every "$name", which must exist in both schemes."""
    if isinstance(value, str) and value.startswith("$"):
        return {scheme: colours[value[1:]] for scheme, colours in theme.SCHEMES.items()}["dark"]
    if isinstance(value, dict):
        return {key: coloured(item) for key, item in value.items()}
    return [coloured(item) for item in value] if isinstance(value, list) else value
