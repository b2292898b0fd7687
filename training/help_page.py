"""``passloc --help``: all commands at a glance."""

from __future__ import annotations

from training.commands import GROUPS, Command
from training.parsing import described

_PAGE = """\
usage: passloc COMMAND [OPTIONS]

Localise a moving emitter that can only be heard: train agents, judge them, see what can be observed at all.

{commands}

passloc COMMAND --help has the options of each, and examples. All take --json FILE for machines (- for standard output)
and -q for silence. The exit status is 0; 1 if something checked is not as it has to be, 2 for what cannot be done as
asked, 130 when interrupted."""

_BEGIN = """\
To begin with:
  passloc demo
  passloc replay BearingsOnly --policy learned,circle,straight --gif replay.gif
  passloc evaluate BearingsOnly --policies learned,circle"""


def help_page() -> str:
    """The page, for lines of up to 120 characters."""
    width = max(len(name) for group in GROUPS.values() for name in group)
    blocks = []
    for title, group in GROUPS.items():
        lines = [f"  {name:{width}}  {_summary(command)}" for name, command in group.items()]
        blocks.append("\n".join([f"{title}:", *lines]))
    return _PAGE.format(commands="\n".join(blocks)) + f"\n\n{_BEGIN}\n"


def _summary(command: Command) -> str:
    return described(command.takes).partition("\n")[0].rstrip(".")
