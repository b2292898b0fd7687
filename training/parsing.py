"""Reading a command line: its words become a command's arguments, or one line that says what is wrong with them."""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import io
import textwrap
from collections.abc import Collection, Sequence
from typing import Any

import tyro

from passloc_env.errors import InputError, closest
from training.commands import COMMANDS

PROGRAM = "passloc"


def parse(name: str, words: Sequence[str]) -> Any:
    """The arguments of a command.

    Args:
        name: of the command.
        words: what follows it.

    Raises:
        InputError: an unknown command, an option that it does not have, or an impossible value.
        SystemExit: help was asked for, and given.
    """
    if name not in COMMANDS:
        raise InputError(f"no command is called {name!r}{_closest(name, COMMANDS)}")
    takes, complaint = COMMANDS[name].takes, io.StringIO()
    arguments: Any
    try:
        with contextlib.redirect_stderr(complaint):
            arguments, unknown = tyro.cli(
                takes,
                prog=f"{PROGRAM} {name}",
                args=words,
                description=described(takes),
                return_unknown_args=True,
            )
    except SystemExit as stop:
        if stop.code:
            raise InputError(f"{name}: {_one_line(complaint.getvalue())}") from None
        raise
    if unknown:
        raise InputError(f"{name} does not know {unknown[0]!r}{_closest(unknown[0], options(takes))}")
    return arguments


def described(takes: type) -> str:
    """What a command does, with its examples."""
    return inspect.getdoc(takes) or ""


def options(takes: type) -> list[str]:
    """The options of a command, as they are typed."""
    fields = [part for field in dataclasses.fields(takes) for part in _parts(field)]
    return [f"--{field.name.replace('_', '-')}" for field in fields]


def _parts(field: dataclasses.Field[Any]) -> Sequence[dataclasses.Field[Any]]:
    """A field, or those of the group that it stands for."""
    return dataclasses.fields(field.default) if dataclasses.is_dataclass(field.default) else (field,)


def _closest(word: str, known: Collection[str]) -> str:
    close = closest(word, known)
    return f"; known: {', '.join(known)}" if close is None else f"; did you mean {close!r}?"


def _one_line(box: str) -> str:
    """What stands below the title in a box that was drawn, with or without lines, for people with time."""
    paragraphs: list[list[str]] = [[]]
    for line in box.splitlines():
        words = line.strip("│╭╮╰╯ ")
        if words and not words.strip("─-"):
            paragraphs.append([])
        elif not line.startswith("╭"):
            paragraphs[-1].append(words)
    body = paragraphs[0] if box.startswith("╭") else paragraphs[1]
    return textwrap.shorten(" ".join(body), 300, placeholder=" …")
