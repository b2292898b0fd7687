"""Completion of commands and options in the shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tyro.conf import Positional

from training.commands.fields import Answer, Output


@dataclass(frozen=True)
class Completion:
    """Print what lets your shell complete commands.

    Examples:
        passloc completion bash
        passloc completion zsh
    """

    shell: Positional[Literal["bash", "zsh", "tcsh"]]
    """Which shell. For bash: passloc completion bash > ~/.local/share/bash-completion/completions/passloc"""
    output: Answer = Output()
