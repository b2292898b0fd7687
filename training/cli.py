"""The command ``passloc``."""

from __future__ import annotations

import atexit
import importlib
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

from passloc_env.errors import InputError, RenderError, WorkerError
from training.commands import COMMANDS, Asked
from training.parsing import PROGRAM, parse

_UNMET, _REFUSED, _INTERRUPTED, _TERMINATED = 1, 2, 130, 143


class _Terminated(BaseException):
    """The command was interrupted by SIGTERM."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit status. Faults of the input are one line on standard error and status 2.

    Args:
        arguments: the words after the program's name; by default those that it was called with.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] in (["--help"], ["-h"]):
        from training.help_page import help_page

        print(help_page(), end="")
        return 0
    if words[:1] == ["--version"]:
        import passloc_env

        print(f"{PROGRAM} {passloc_env.__version__}")
        return 0
    try:
        if words[:1] and words[0].startswith("-"):
            raise InputError(f"options follow a command: {PROGRAM} COMMAND {words[0]}")
        if not words:
            raise InputError(f"name a command: {', '.join(COMMANDS)}; {PROGRAM} --help says what they do")
        with _terminable():
            return _answer(words[0], parse(words[0], words[1:]))
    except KeyboardInterrupt:
        return _cut_short("interrupted", _INTERRUPTED)
    except _Terminated:
        return _cut_short("terminated", _TERMINATED)
    except (InputError, RenderError, WorkerError, OSError) as error:
        return _say(str(error), _REFUSED)


@contextmanager
def _terminable() -> Iterator[None]:
    """Meanwhile SIGTERM interrupts the command as Ctrl-C does, unless it has another meaning already."""
    in_charge = threading.current_thread() is threading.main_thread()
    if not in_charge or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    asked = threading.Event()

    def interrupt(*_: object) -> NoReturn:
        asked.set()
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        # Libraries raise another one in its place, so that its type would not tell.
        if asked.is_set():
            raise _Terminated from None
        raise
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _answer(name: str, arguments: Asked) -> int:
    """Let a command answer, and write its answer where that was asked for."""
    from training.answer import Unmet, give, prepared
    from training.files import forget

    output = arguments.output
    module, _, function = COMMANDS[name].answered_by.partition(":")
    forget()
    with prepared(arguments):
        answers = getattr(importlib.import_module(module), function)
        try:
            give(output, answers(arguments))
        except Unmet as unmet:
            give(output, unmet.answer)
            return _say(str(unmet), _UNMET)
    return 0


def _cut_short(how: str, status: int) -> int:
    # One more Ctrl-C must not add the traceback of a library that is leaving.
    atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
    return _say(f"{how}; {_what_is_saved()}", status)


def _what_is_saved() -> str:
    from training.files import saved

    return f"saved so far: {', '.join(saved())}" if saved() else "nothing was saved"


def _say(message: str, status: int) -> int:
    print(f"{PROGRAM}: {message}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
