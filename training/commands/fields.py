"""What many commands take, described once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Protocol, TypeAlias

import tyro
from tyro.conf import OmitArgPrefixes, Positional

EVALUATION_SEED = 1_000_000
"""First evaluation seed; training seeds are at least 2⁶² (see ``passloc_env.sb3``)."""

ScenarioName = Annotated[
    Positional[str],
    tyro.conf.arg(metavar="SCENARIO", help="Name, Gymnasium id, or path of a scenario file (YAML or JSON)."),
]
"""Which scenario."""

Overrides = Annotated[
    tuple[str, ...],
    tyro.conf.arg(
        metavar="NAME=VALUE …", help="Scenario fields to change, by their dotted names.", help_behavior_hint=""
    ),
]
"""Changes to it."""

File = Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")]
"""A file to write, if any."""

Folder = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")]
"""A folder to write into, where there is a default that depends on something else."""


@dataclass(frozen=True)
class Output:
    """How the answer is given."""

    json: File = None
    """Also write the answer here as JSON; - writes it, and nothing else, to standard output."""
    quiet: Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(aliases=["-q"])] = False
    """Say nothing but errors, and show no progress."""


class Asked(Protocol):
    """The arguments of any command."""

    @property
    def output(self) -> Output:
        """How the answer is to be given."""


Answer: TypeAlias = OmitArgPrefixes[Output]
"""The last field of every command."""


@dataclass(frozen=True)
class Work:
    """Where the work is done; the results are the same."""

    engine: Literal["local", "ray"] = "local"
    """Processes of this machine, or a Ray cluster."""
    workers: Annotated[int | None, tyro.conf.arg(metavar="N", help_behavior_hint="")] = None
    """Processes at once; by default one, or as many as the cluster has processors."""
    address: Annotated[str, tyro.conf.arg(metavar="ADDRESS", help_behavior_hint="")] = ""
    """The Ray cluster, auto for the one that this machine belongs to; by default one is started here."""


Where: TypeAlias = OmitArgPrefixes[Work]
"""The last field but one of commands whose work can be divided."""
