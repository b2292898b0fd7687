"""What the command line takes: one documented dataclass per command, and who answers it.

Light to import, so that help is quick.
"""

from __future__ import annotations

from typing import NamedTuple

from training.commands.completion import Completion
from training.commands.fields import EVALUATION_SEED, Asked, Output
from training.commands.judging import Card, Evaluate, Leaderboard, Report
from training.commands.learning import Ablate, Convert, Demo, Seeds, Train, Tune
from training.commands.looking import Export, List, NewScenario, Observe, Replay
from training.commands.verifying import Bench, Reproduce, Soak

__all__ = [
    "COMMANDS",
    "EVALUATION_SEED",
    "GROUPS",
    "Ablate",
    "Asked",
    "Bench",
    "Card",
    "Command",
    "Completion",
    "Convert",
    "Demo",
    "Evaluate",
    "Export",
    "Leaderboard",
    "List",
    "NewScenario",
    "Observe",
    "Output",
    "Replay",
    "Report",
    "Reproduce",
    "Seeds",
    "Soak",
    "Train",
    "Tune",
]


class Command(NamedTuple):
    """A command.

    Attributes:
        takes: the dataclass of its arguments.
        answered_by: the function that takes them, as module:name; imported when it is wanted.
    """

    takes: type
    answered_by: str


GROUPS: dict[str, dict[str, Command]] = {
    "look": {
        "list": Command(List, "training.scenario_list:list_known"),
        "new-scenario": Command(NewScenario, "training.starter:new_scenario"),
        "replay": Command(Replay, "training.replay:replay"),
        "observe": Command(Observe, "training.observe:observe"),
        "export": Command(Export, "training.export.command:export"),
    },
    "train": {
        "demo": Command(Demo, "training.demo:demo"),
        "train": Command(Train, "training.train:train_and_say"),
        "convert": Command(Convert, "training.convert:convert"),
        "tune": Command(Tune, "training.tune:tune"),
        "seeds": Command(Seeds, "training.seeds:seeds"),
        "ablate": Command(Ablate, "training.ablation:ablate"),
    },
    "judge": {
        "evaluate": Command(Evaluate, "training.judging:judge_policies"),
        "report": Command(Report, "training.report:report"),
        "leaderboard": Command(Leaderboard, "training.leaderboard:leaderboard"),
        "card": Command(Card, "training.card:card"),
    },
    "verify": {
        "reproduce": Command(Reproduce, "training.reproduce:reproduce"),
        "bench": Command(Bench, "training.benchmark:run"),
        "soak": Command(Soak, "training.reliability.command:soak"),
    },
    "this program": {
        "completion": Command(Completion, "training.completion:completion"),
    },
}
"""The commands, by what they are for."""

COMMANDS: dict[str, Command] = {name: command for group in GROUPS.values() for name, command in group.items()}
"""All commands by name."""
