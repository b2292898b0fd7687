"""Entry point of the ``passloc`` command: the usual faults of an installation become one line each."""

from __future__ import annotations

import importlib
import sys
from typing import NoReturn

from passloc_env.shadowing import OURS, explain, shadowed

EXTRAS = {
    "train": frozenset(
        {
            "filelock",
            "optuna",
            "rich",
            "safetensors",
            "shtab",
            "sqlalchemy",
            "stable_baselines3",
            "tensorboard",
            "torch",
            "tqdm",
            "tyro",
        }
    ),
    "distributed": frozenset({"ray"}),
    "export": frozenset({"pyarrow", "stonesoup"}),
    "render": frozenset({"PIL", "imageio_ffmpeg", "jinja2", "matplotlib", "plotly", "pygame"}),
}
"""Import names of what the extras install."""


def main() -> NoReturn:
    """Runs the command line and exits with its status, or with 2 when the installation cannot run it."""
    for name in OURS:
        if path := shadowed(name):
            _refuse(explain(name, path))
    try:
        status = importlib.import_module("training.cli").main()
    except ModuleNotFoundError as error:
        # Only a library that is absent as a whole means a missing extra; anything else is a bug to be seen.
        for extra, modules in EXTRAS.items():
            if error.name in modules:
                _refuse(f"passloc: this needs the {extra!r} extra: pip install 'passloc[{extra}]'")
        raise
    sys.exit(status)


def _refuse(message: str) -> NoReturn:
    print(message, file=sys.stderr)
    sys.exit(2)
