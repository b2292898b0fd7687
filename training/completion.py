"""Completion scripts for shells; ``passloc completion``."""

from __future__ import annotations

import contextlib
import io
import sys
from typing import Annotated, Any, Union

import tyro

from training.commands import COMMANDS, Completion
from training.parsing import PROGRAM


def completion(arguments: Completion) -> dict[str, str]:
    """Print the script for a shell."""
    script = completion_script(arguments.shell)
    if not arguments.output.quiet and arguments.output.json is None:
        sys.stdout.write(script)
    return {"shell": arguments.shell, "script": script}


def completion_script(shell: str) -> str:
    """What a shell has to read in order to complete our commands and their options."""
    each = [Annotated[command.takes, tyro.conf.subcommand(name)] for name, command in COMMANDS.items()]
    every: Any = Union[tuple(each)]  # noqa: UP007 - made of a list
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        tyro.cli(every, prog=PROGRAM, args=["--tyro-print-completion", shell])
    return printed.getvalue()
