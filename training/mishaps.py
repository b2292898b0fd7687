"""What ends a training before its time, said in one line with what can be done about it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from passloc_env.errors import InputError
from training.checkpoint import LATEST, has_checkpoint
from training.files import cannot_write
from training.vector_ppo import VectorPPO

_NOT_FINITE = "Expected parameter"
"""How PyTorch's distributions begin to say that a network gives no numbers."""


@contextmanager
def told(folder: Path, model: VectorPPO, learning_rate: float) -> Iterator[None]:
    """While a run learns into its folder, and writes there.

    Raises:
        InputError: the learner has diverged.
        OSError: something cannot be written; the message says how to go on.
    """
    try:
        yield
    except OSError as error:
        said = error if error.strerror is None else cannot_write(folder, error)
        raise type(error)(f"{said}; {_way_on(folder)}") from None
    except ValueError as error:
        if not str(error).startswith(_NOT_FINITE):
            raise
        kept = f"the last checkpoint is {folder / LATEST}" if has_checkpoint(folder) else "there is no checkpoint"
        raise InputError(
            f"the learner has diverged after {model.num_timesteps:,} decisions, its policy gives no finite numbers: "
            f"learning_rate = {learning_rate:g} may be too large; {kept}"
        ) from None


def _way_on(folder: Path) -> str:
    whole = (
        "what was saved before is whole" if has_checkpoint(folder) else "no checkpoint was saved, it begins anew with"
    )
    return f"{whole}: passloc train --resume {folder}"
