"""Writing a flown episode as tables; ``passloc export``."""

from __future__ import annotations

from pathlib import Path

from agents import find_policy
from passloc_env.scenarios import find
from training.arguments import check_seed, parse_overrides, writable_folder
from training.commands import Export
from training.export.flight import fly
from training.export.tables import encoder, write_tables
from training.progress import console


def export(arguments: Export) -> list[Path]:
    """Fly the episode and write its tables, which are returned.

    Raises:
        InputError: an unknown scenario or policy, or a negative seed.
        ModuleNotFoundError: Parquet without pyarrow; told, like all else, before anything is flown.
        OSError: a folder that cannot be written into.
    """
    check_seed(arguments.seed)
    scenario = find(arguments.scenario).override(parse_overrides(arguments.override))
    policy = find_policy(arguments.policy, scenario)
    encoder(arguments.format)
    folder = writable_folder(arguments.out)
    paths = write_tables(fly(scenario, policy, arguments.seed), folder, arguments.format)
    for path in paths:
        console.print(f"    {path}", highlight=False, soft_wrap=True)
    return paths
