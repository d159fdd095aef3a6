"""TOML files: parsing with the line of every key, which the parser itself forgets."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skytrace.errors import InputError

_TABLE = re.compile(r"""^\s*(\[\[?)\s*["']?([^\]"']+?)["']?\s*\]\]?\s*(?:\#.*)?$""")
_KEY = re.compile(r"""^\s*["']?([\w-]+)["']?\s*(?:\.[^=]*)?=""")


@dataclass(frozen=True, slots=True)
class TomlFile:
    """The values of a TOML file and where its keys stand."""

    path: Path
    values: dict[str, Any]
    lines: dict[tuple[str, int, str], int]  # (table, index in an array of tables, key) -> line; key "" is the header

    def line(self, table: str, index: int, key: str = "") -> int | None:
        """The line of a key, else that of its table's header; None where neither is written on a line of its own."""
        return self.lines.get((table, index, key), self.lines.get((table, index, "")))


def parse_toml(path: Path, text: str) -> TomlFile:
    """Parse TOML text read from `path`. Raises InputError with the line of a syntax error."""
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        where = re.search(r"\s*\(at (?:line (\d+), column \d+|end of document)\)$", str(error))
        reason = str(error)[: where.start()] if where else str(error)
        line = int(where[1]) if where and where[1] else text.rstrip("\n").count("\n") + 1
        raise InputError(path, f"not valid TOML: {reason}", line=line) from None
    return TomlFile(path, values, _key_lines(text))


def _key_lines(text: str) -> dict[tuple[str, int, str], int]:
    lines: dict[tuple[str, int, str], int] = {}
    table, index, seen = "", 0, {}
    for number, line in enumerate(text.split("\n"), 1):
        if header := _TABLE.match(line):
            table = header[2]
            index = seen.get(table, -1) + 1 if header[1] == "[[" else 0
            seen[table] = index
            lines.setdefault((table, index, ""), number)
        elif key := _KEY.match(line):
            lines.setdefault((table, index, key[1]), number)
    return lines


def toml_string(value: str) -> str:
    """A TOML basic string. JSON escapes the same characters, but for delete, which TOML forbids in the raw."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
