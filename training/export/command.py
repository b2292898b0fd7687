"""Writing a flown episode as tables; ``passloc export``. Light to import, so that help is quick."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from training.commands import EVALUATION_SEED


@dataclass(frozen=True)
class Export:
    """Fly an episode and write it as tables: truth, platforms, detections, tracks.

    Examples:
        passloc export BearingsOnly --out runs/flight
        passloc export BearingDoppler --policy learned --seed 1000003 --format parquet --out runs/flight
        passloc export my_scenario.yaml --override sensors.0.sigma=0.01 --out runs/flight
    """

    scenario: Positional[str] = "BearingsOnly"
    """Name, Gymnasium id, or path of a scenario file (YAML or JSON)."""
    policy: str = "circle"
    """Rule or path of a trained agent that flies the episode."""
    seed: int = EVALUATION_SEED
    """Seed of the episode."""
    out: Path = Path("runs/export")
    """Folder of the tables; tables that are there are replaced."""
    format: Literal["csv", "parquet"] = "csv"
    """Kind of file; Parquet needs passloc[export]."""
    override: tuple[str, ...] = ()
    """Scenario fields to change, as dotted.name=value."""


def export(arguments: Export) -> None:
    """Fly the episode and write its tables; the files are named on the console.

    Raises:
        InputError: an unknown scenario or policy, or a negative seed.
        ModuleNotFoundError: Parquet without pyarrow; told, like all else, before anything is flown.
        OSError: a folder that cannot be written into.
    """
    from agents import find_policy
    from training.arguments import check_seed, parse_overrides, read_scenario, writable_folder
    from training.export.flight import fly
    from training.export.tables import encoder, write_tables
    from training.progress import console

    check_seed(arguments.seed)
    scenario = read_scenario(arguments.scenario).override(parse_overrides(arguments.override))
    policy = find_policy(arguments.policy, scenario)
    encoder(arguments.format)
    folder = writable_folder(arguments.out)
    for path in write_tables(fly(scenario, policy, arguments.seed), folder, arguments.format):
        console.print(f"    {path}", highlight=False, soft_wrap=True)
