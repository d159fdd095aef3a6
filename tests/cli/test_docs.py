"""The documentation does what it says: its commands run, its flights are read, its links and quotations hold.

Blocks marked `console` hold commands, which run one after the other in a folder with what `filmed` puts there. Blocks
marked `toml` are flights: one whose first line is a comment with a path is written there, others are additions to the
flight that was filmed.
"""

from __future__ import annotations

import ast
import re
import runpy
import shlex
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import tomli_w

from skytrace.io.flight import read_flight
from skytrace.io.flight_schema import CameraKeys, DistanceKeys, FlightKeys, MomentKeys, TruthKeys

from .command import skytrace
from .filmed import FLIGHT, film

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
_BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
_NO_TEXT = re.compile(r"^```.*?^```$|`[^`\n]*`|\$[^$\n]*\$", re.MULTILINE | re.DOTALL)  # code and formulae
_LINK = re.compile(r"\[[^]]*\]\(([^)\s]+)\)")
_QUOTED = re.compile(r"^\| \*(.+?)\* \|", re.MULTILINE)


def blocks(page: Path) -> list[tuple[str, str]]:
    """The language and the text of every fenced block."""
    return [(m[2], re.sub(rf"^{m[1]}", "", m[3], flags=re.MULTILINE)) for m in _BLOCK.finditer(page.read_text("utf-8"))]


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("filmed") / "evening"
    folder.mkdir()
    film(folder)
    return folder


@pytest.mark.parametrize(
    "page", [p for p in PAGES if {"console", "toml"} & {kind for kind, _ in blocks(p)}], ids=name_of
)
def test_commands_run_and_flights_are_read(page: Path, filmed: Path, tmp_path: Path, monkeypatch) -> None:
    folder = tmp_path / "evening"
    shutil.copytree(filmed, folder)
    monkeypatch.chdir(folder)
    for kind, text in blocks(page):
        if kind == "console":
            for command in commands(text):
                result = skytrace(*command)
                assert result.code == 0, f"{shlex.join(command)}\n{result.err}"
                # What is recommended must not be what the program warns of.
                assert not re.search(r"^(skytrace: )?warning", result.out + result.err, re.MULTILINE), result.out
        elif kind == "toml":
            read_block(text, folder)


def commands(text: str) -> Iterator[list[str]]:
    """The arguments of each `$ skytrace ...` in a block; lines without a `$` are what it prints."""
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith("$ "):
            words = shlex.split(line[2:], comments=True)
            assert words[0] == "skytrace", f"{line}: mark what is not to be run as sh, not console"
            yield words[1:]


def read_block(text: str, folder: Path) -> None:
    """Write and read a whole flight, or read the flight that was filmed with an addition."""
    first = text.partition("\n")[0]
    if named := re.fullmatch(r"# (\S+\.toml)", first):
        (folder / named[1]).write_text(text)
        read_flight(folder / named[1])
        return
    addition, flight = tomllib.loads(text), tomllib.loads(FLIGHT)
    cameras = {camera["id"]: camera for camera in flight["camera"]}
    if any(camera["id"] not in cameras for camera in addition.get("camera", ())):
        msgspec.convert(addition, FlightKeys)  # a flight of other files, which are not here
        return
    for key, value in addition.items():
        if key == "camera":
            merge_cameras(cameras, value)
        else:
            flight[key] = value
    merged = folder / "saturday" / "merged.toml"
    merged.write_text(tomli_w.dumps(flight))
    read_flight(merged)


def merge_cameras(cameras: dict[str, Any], additions: list[dict[str, Any]]) -> None:
    for camera in additions:
        own = cameras[camera["id"]]
        if "detections" in camera:
            del own["video"]
        own |= camera


def test_the_commands_are_those_of_the_command_line() -> None:
    found = runpy.run_path(str(ROOT / "docs" / "make_commands.py"))
    committed = (ROOT / "docs" / "commands.md").read_text("utf-8")
    assert committed == found["reference"](), "run make docs (python docs/make_commands.py)"


@pytest.mark.parametrize("page", [*PAGES, *sorted((ROOT / "docs" / "decisions").glob("*.md"))], ids=name_of)
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(_NO_TEXT, "code", page.read_text("utf-8"))
    for link in _LINK.findall(text):
        if link.startswith(("http://", "https://")):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target), link


def anchors(page: Path) -> set[str]:
    """As GitHub makes them of headings."""
    headings = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.replace("`", "")).strip().lower().replace(" ", "-") for h in headings}


def test_every_page_is_in_the_index() -> None:
    index = (ROOT / "docs" / "README.md").read_text("utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        assert page.name == "README.md" or f"({page.name})" in index


def test_every_key_of_a_flight_is_explained() -> None:
    text = (ROOT / "docs" / "formats.md").read_text("utf-8")
    explained = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`\n]+)`", text))))
    tables = [FlightKeys, CameraKeys, MomentKeys, DistanceKeys, TruthKeys]
    assert {key for table in tables for key in table.__struct_fields__} - explained == set()


def test_what_the_program_is_quoted_with_it_says() -> None:
    """Cells in italics quote warnings and errors; an ellipsis stands for what differs from case to case."""
    said = "\n".join(
        node.value
        for source in (ROOT / "src").rglob("*.py")
        for node in ast.walk(ast.parse(source.read_text("utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
    quoted = [(page, phrase) for page in PAGES for phrase in _QUOTED.findall(page.read_text("utf-8"))]
    assert len(quoted) > 10
    for page, phrase in quoted:
        for part in phrase.split("…"):
            assert part.strip() in said, f"{name_of(page)}: {part}"
