"""Text files: reading them whole, and naming the line a mistake stands on."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path

from skytrace.errors import InputError


def read_text(path: Path, what: str) -> str:
    """The text of a UTF-8 file (with or without byte order mark), every kind of line end turned into a newline.

    Raises InputError, calling the file a `what`, when it is missing, unreadable or not text.
    """
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise InputError(path, f"{what} does not exist") from None
    except IsADirectoryError:
        raise InputError(path, f"{what} is a folder, expected a file") from None
    except OSError as error:
        raise InputError(path, f"{what} cannot be read: {error.strerror or error}") from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(path, f"{what} is not UTF-8 text; convert it, or check the path", line=line) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise InputError(path, f"{what} holds binary data, expected text; check the path", line=line)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def line_of(text: str, pattern: str) -> int | None:
    """The number, from 1, of the first line where a regular expression matches; None where none does."""
    match = re.search(pattern, text, re.MULTILINE)
    return None if match is None else text.count("\n", 0, match.start()) + 1


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A parenthesis that suggests the known word nearest to a misspelt one; empty where none is near."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f" (did you mean {near[0]!r}?)" if near else ""


def shortened(text: str, limit: int = 60) -> str:
    """A quoted piece of a file, cut to a length that fits into a message."""
    text = text.strip()
    return repr(text if len(text) <= limit else text[: limit - 3] + "...")
