"""Frame times as ffprobe prints them: one a line, or `key=value` lines, of packets or frames.

    ffprobe -select_streams v -show_entries packet=pts_time -of csv=p=0 VIDEO
    ffprobe -select_streams v -show_entries frame=best_effort_timestamp_time VIDEO

Packets come in the order in which they are decoded: where pictures refer to later ones (B-frames) a packet may come
before others that are shown earlier. Frame k is the k-th in the order of presentation.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.io.text import read_text, shortened

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
# One time a line: with `p=1` after the section's name, and before what side data leave behind it.
_LINE = re.compile(rf"(?:(?P<section>packet|frame)[,|])?(?P<value>{_NUMBER}|N/A)(?:[,|]+(?:[A-Za-z_].*)?)?")
_SECTION = re.compile(r"\[(?P<end>/?)(?P<name>[A-Z_]+)\]")
_PAIR = re.compile(r"(?P<key>[A-Za-z_:]+)=(?P<value>.*)")
_KEYS = ("best_effort_timestamp_time", "pts_time", "pkt_pts_time")  # best first
_COMMAND = "ffprobe -select_streams v -show_entries frame=best_effort_timestamp_time -of csv=p=0 VIDEO"
_MOST_REORDERED = 16  # frames; H.264 and HEVC decoders hold no more


@dataclass(frozen=True, eq=False, slots=True)
class Listing:
    """Presentation times of frames, numbered from 0; frames without one are absent."""

    frame: IntArray  # (n,)
    time_s: FloatArray  # (n,) never falling


@dataclass(frozen=True, slots=True)
class _Entry:
    time_s: float | None  # none: N/A
    line: int
    presented: bool  # known to be in the order of presentation


def is_listing(text: str) -> bool:
    """Whether text looks like times listed by ffprobe rather than like a table of frames and times."""
    for line in _lines(text):
        return bool(_LINE.fullmatch(line[1]) or _SECTION.fullmatch(line[1]) or _PAIR.fullmatch(line[1]))
    return False


def read_listing(path: Path | str) -> Listing:
    """Read a listing by ffprobe in its `csv` or `default` format.

    Raises InputError with the line of what is no time, of a time that steps back further than a video's frames are
    reordered, and of a frame without time where that leaves frames unnumbered.
    """
    path = Path(path)
    lines = list(_lines(read_text(path, "time stamps")))
    keyed = _SECTION.fullmatch(lines[0][1]) or _PAIR.fullmatch(lines[0][1])
    entries = _keyed_entries(path, lines) if keyed else [_entry(path, *line) for line in lines]
    known = [e for e in entries if e.time_s is not None]
    if not known:
        raise InputError(path, f"time stamps: no frame has a time; list them with {_COMMAND}", line=lines[0][0])
    time_s = np.array([e.time_s for e in known], np.float64)
    frame = np.array([k for k, e in enumerate(entries) if e.time_s is not None], np.int64)
    falls = np.flatnonzero(np.diff(time_s) < 0)
    if len(falls):
        _refuse_disorder(path, entries, known, time_s, int(falls[0]) + 1)
        time_s = np.sort(time_s)
    return Listing(frame, time_s)


def _lines(text: str) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text.split("\n"), 1):
        stripped = line.strip()
        if stripped and not stripped.startswith("#"):
            yield number, stripped


def _entry(path: Path, line: int, text: str) -> _Entry:
    match = _LINE.fullmatch(text)
    if match is None:
        raise InputError(path, f"expected one time in seconds a line, got {shortened(text)}", line=line)
    return _Entry(_time(path, line, match["value"]), line, presented=match["section"] == "frame")


def _time(path: Path, line: int, value: str) -> float | None:
    if value == "N/A":
        return None
    if not re.fullmatch(_NUMBER, value):
        raise InputError(path, f"expected a time in seconds or N/A, got {shortened(value)}", line=line)
    return float(value)


def _keyed_entries(path: Path, lines: list[tuple[int, str]]) -> list[_Entry]:
    """One entry a section; without sections, one each time the key comes."""
    keys = {match["key"] for _, text in lines if (match := _PAIR.fullmatch(text))}
    key = next((k for k in _KEYS if k in keys), None)
    if key is None:
        message = (
            f"time stamps: expected {' or '.join(_KEYS)}, got {', '.join(sorted(keys)) or 'no key'}; list them with"
        )
        raise InputError(path, f"{message} {_COMMAND}", line=lines[0][0])
    entries: list[_Entry] = []
    section: dict[str, str] | None = None
    begun, name = 0, ""
    for line, text in lines:
        if mark := _SECTION.fullmatch(text):
            if mark["name"] not in ("PACKET", "FRAME"):
                continue
            if not mark["end"]:
                section, begun, name = {}, line, mark["name"]
            elif section is not None:
                # Without -select_streams v the other streams are listed too.
                if section.get("codec_type", section.get("media_type", "video")) == "video":
                    entries.append(
                        _Entry(_time(path, begun, section.get(key, "N/A")), begun, presented=name == "FRAME")
                    )
                section = None
        elif (pair := _PAIR.fullmatch(text)) is None:
            raise InputError(path, f"expected key=value, got {shortened(text)}", line=line)
        elif section is not None:
            section.setdefault(pair["key"], pair["value"])
            if pair["key"] == key:
                begun = line
        elif pair["key"] == key:
            presented = key == "best_effort_timestamp_time"
            entries.append(_Entry(_time(path, line, pair["value"]), line, presented))
    return entries


def _refuse_disorder(path: Path, entries: list[_Entry], known: list[_Entry], time_s: FloatArray, fall: int) -> None:
    """Times that step back are fine where B-frames explain them, and nothing else is."""
    stepped = f"time steps back from {time_s[fall - 1]:.9g} to {time_s[fall]:.9g} s"
    if known[fall].presented:
        raise InputError(path, f"{stepped}, though these are frames in order of presentation", line=known[fall].line)
    if missing := [e for e in entries if e.time_s is None]:
        message = f"N/A in a list that is not in order of time leaves frames unnumbered; list them with {_COMMAND}"
        raise InputError(path, message, line=missing[0].line)
    moved = np.argsort(time_s, kind="stable") - np.arange(len(time_s))
    if np.abs(moved).max() > _MOST_REORDERED:
        worst = int(np.argmin(np.diff(time_s))) + 1
        message = (
            f"time steps back from {time_s[worst - 1]:.9g} to {time_s[worst]:.9g} s, further than a video's frames are "
            "reordered: expected one recording whose clock was not set back"
        )
        raise InputError(path, message, line=known[worst].line)
