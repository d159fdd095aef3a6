"""Write docs/commands.md from what the command line says of itself: `python docs/make_commands.py`."""

from __future__ import annotations

import enum
import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

import typer
from typer.models import ArgumentInfo, OptionInfo, ParameterInfo

from skytrace.cli.app import app

TARGET = Path(__file__).with_name("commands.md")
_VALUES = {Path: "PATH", str: "TEXT", int: "NUMBER", float: "NUMBER"}
_HEAD = """\
# Commands

`skytrace COMMAND --help` says the same in a terminal. This page is written by `python docs/make_commands.py`; edit the
command line, not the page.

Results go to stdout, progress and warnings about files to stderr. Exit codes: 0 done, 2 wrong usage, 3 an input is
missing or wrong, 4 the data determine no solution, 130 interrupted. Nothing half-written is left behind.
"""


def reference() -> str:
    """The page."""
    parts = [_HEAD]
    for words, function in commands(app):
        parameters = list(_parameters(function))
        arguments = [p for p in parameters if isinstance(p[2], ArgumentInfo)]
        required = [p for p in parameters if isinstance(p[2], OptionInfo) and p[3] is inspect.Parameter.empty]
        shown = [*(_in_usage(*p) for p in arguments), *(_in_usage(*p) for p in required)]
        usage = " ".join(["skytrace", *words, *shown, "[OPTIONS]"])
        rows = [f"| `{_escaped(_spelling(*p))}` | {_escaped(_meaning(*p))} |" for p in parameters]
        table = "\n".join(["| | |", "| --- | --- |", *rows])
        parts.append(f"## {' '.join(words)}\n\n    {usage}\n\n{inspect.getdoc(function)}\n\n{table}\n")
    return "\n".join(parts)


def commands(group: typer.Typer, above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Callable[..., Any]]]:
    """The words and the function of every command of a group, those of the groups in it last."""
    for command in group.registered_commands:
        assert command.callback is not None  # the decorator sets it
        yield (*above, command.name or command.callback.__name__.replace("_", "-")), command.callback
    for inner in group.registered_groups:
        assert inner.typer_instance is not None
        yield from commands(inner.typer_instance, (*above, str(inner.name)))


def _parameters(function: Callable[..., Any]) -> Iterator[tuple[str, Any, ParameterInfo, Any]]:
    """Name, type, what is said of it, and default of each parameter, arguments first."""
    hints, found = get_type_hints(function, include_extras=True), []
    for name, parameter in inspect.signature(function).parameters.items():
        kind, about = get_args(hints[name])
        found.append((name, kind, about, parameter.default))
    yield from sorted(found, key=lambda p: isinstance(p[2], OptionInfo))


def _in_usage(name: str, kind: Any, about: ParameterInfo, default: Any) -> str:
    shown = _spelling(name, kind, about, default).rpartition(", ")[2]
    several = isinstance(_plain(kind), type(list[int])) and "..." not in shown
    shown += "..." if several else ""
    return shown if default is inspect.Parameter.empty else f"[{shown}]"


def _spelling(name: str, kind: Any, about: ParameterInfo, default: Any) -> str:
    """An argument's placeholder, or an option's names and the placeholder of its value."""
    if isinstance(about, ArgumentInfo):
        return about.metavar or name.upper()
    # In Annotated, the first name stands where the default would.
    declared = (about.default, *(about.param_decls or ())) if isinstance(about.default, str) else about.param_decls
    names = ", ".join(declared or (f"--{name.replace('_', '-')}",))
    plain = _plain(kind)
    if plain is bool:
        return names
    if isinstance(plain, type) and issubclass(plain, enum.Enum):
        return f"{names} {about.metavar or '|'.join(str(choice.value) for choice in plain)}"
    return f"{names} {about.metavar or _VALUES.get(plain, 'TEXT')}"


def _plain(kind: Any) -> Any:
    """The type of a value where one is given."""
    return next((part for part in get_args(kind) if part is not NoneType), kind) if NoneType in get_args(kind) else kind


def _meaning(name: str, kind: Any, about: ParameterInfo, default: Any) -> str:
    words = [str(about.help)]
    given = [f"{about.min:g}" if about.min is not None else "", f"{about.max:g}" if about.max is not None else ""]
    if any(given):
        words.append(f"At least {given[0]}." if not given[1] else f"From {given[0]} to {given[1]}.")
    if about.envvar:
        words.append(f"Also from the environment variable `{about.envvar}`.")
    if isinstance(about, OptionInfo) and default is inspect.Parameter.empty:
        words.append("Required.")
    elif default is not inspect.Parameter.empty and default is not None and default is not False:
        words.append(f"Default: `{default}`.")
    return " ".join(words)


def _escaped(text: str) -> str:
    """Text for a cell of a table, where a bar would end it even inside backquotes."""
    return text.replace("|", "\\|")


if __name__ == "__main__":
    TARGET.write_text(reference(), encoding="utf-8")
