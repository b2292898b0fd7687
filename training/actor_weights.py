"""The layers of an actor from the weights of a Stable-Baselines3 policy, as torch has saved them."""

from __future__ import annotations

import io
import itertools
import re
import zipfile
from typing import Any

import numpy as np
import torch

from agents.agent_file import SIZES_LIMIT, WEIGHTS_LIMIT
from passloc_env.errors import InputError, shown
from training.archives import open_archive

_HIDDEN = re.compile(r"mlp_extractor\.policy_net\.(\d{1,3})\.weight")
_KNOWN = re.compile(r"log_std|(mlp_extractor\.(policy|value)_net\.\d{1,3}|action_net|value_net)\.(weight|bias)")
"""What an actor and a critic of plain layers consist of."""

Layer = tuple[np.ndarray, np.ndarray]


def actor_layers(content: bytes) -> list[Layer]:
    """Weight ``(out, in)`` and bias ``(out,)`` of each layer of the actor, float32.

    Args:
        content: of a file of weights; its pickle may name tensors, and is refused if it names anything else.

    Raises:
        InputError: other content, other layers, or weights that are too large or not finite.
    """
    state = _state(content)
    for name in state:
        if not _KNOWN.fullmatch(str(name)):
            raise InputError(f"holds {shown(name)}: only actors of plain layers can be converted")
    numbers = sorted(int(found[1]) for found in map(_HIDDEN.fullmatch, state) if found)
    # A function without weights stands between any two layers.
    if numbers != list(range(0, 2 * len(numbers), 2)):
        raise InputError("has other layers than an actor with tanh between them")
    names = [*(f"mlp_extractor.policy_net.{number}" for number in numbers), "action_net"]
    if len(names) >= SIZES_LIMIT:
        raise InputError(f"has {len(names)} layers, more than the {SIZES_LIMIT - 1} that an agent may have")
    tensors = [(_tensor(state, f"{name}.weight", 2), _tensor(state, f"{name}.bias", 1)) for name in names]
    _check_sizes(tensors)
    layers = [(weight.detach().numpy().copy(), bias.detach().numpy().copy()) for weight, bias in tensors]
    for name, (weight, bias) in zip(names, layers, strict=True):
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise InputError(f"has a {name} that is not finite")
    return layers


def _state(content: bytes) -> dict[Any, Any]:
    """The tensors by name, all of them in memory as they are in the file."""
    for member in open_archive(content).infolist():
        if member.compress_type != zipfile.ZIP_STORED:
            raise InputError("has weights that are packed, as torch does not")
    try:
        state = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception:  # Whatever torch stumbles over: its unpickler of weights alone is all that ever sees the file.
        raise InputError("has weights that are damaged, or hold more than weights") from None
    if not isinstance(state, dict):
        raise InputError("has weights without names")
    return state


def _tensor(state: dict[Any, Any], name: str, axes: int) -> torch.Tensor:
    """A tensor of the weights, as it is in the file; InputError unless it is plain and of some size."""
    tensor = state.get(name)
    plain = ("cpu", torch.float32, torch.strided, axes)
    if (
        not isinstance(tensor, torch.Tensor)
        or (tensor.device.type, tensor.dtype, tensor.layout, tensor.dim()) != plain
        or not tensor.numel()
    ):
        raise InputError(f"has no {name} of {axes} axes and single precision")
    return tensor


def _check_sizes(layers: list[tuple[torch.Tensor, torch.Tensor]]) -> None:
    """InputError for layers that do not fit each other, or that are too large together."""
    widths = [(weight.shape[0], len(bias)) for weight, bias in layers]
    fed = [(before.shape[0], after.shape[1]) for (before, _), (after, _) in itertools.pairwise(layers)]
    if any(one != other for one, other in widths + fed):
        raise InputError("has layers that do not fit each other")
    # A tensor may claim to be far larger than what it stands on, so that the size of the file bounds nothing.
    if sum(tensor.numel() * tensor.element_size() for layer in layers for tensor in layer) > WEIGHTS_LIMIT:
        raise InputError("has weights that are larger than those of an agent may be")
