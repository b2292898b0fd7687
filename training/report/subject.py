"""What a report is about: a training run, an evaluation, or both."""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from agents import LearnedPolicy, Policy, default_policies, find_policy
from agents.agent_file import AgentFile
from passloc_env.arrays import Array
from passloc_env.errors import InputError
from passloc_env.scenario import Scenario
from training.curve import read_curve
from training.evaluate import Evaluation, read_evaluation
from training.judging import judge
from training.table import ranked

_CURVE, _EVALUATION = "curve.csv", "evaluation.json"
_SHOWN = 4
"""Policies whose flights are shown at most."""


@dataclass
class Subject:
    """Everything a report shows, before it is drawn.

    Attributes:
        evaluation: who was judged, and how they did.
        policies: those whose flights can be shown, by their names in the evaluation.
        curve: of the training, by column; None without one.
        training: what the agent's card says of its training; empty without an agent.
        remarks: what is missing, and why.
    """

    evaluation: Evaluation
    policies: dict[str, Policy]
    curve: dict[str, Array] | None = None
    training: dict[str, Any] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    @property
    def scenario(self) -> Scenario:
        """The problem."""
        return self.evaluation.scenario

    def shown(self) -> dict[str, Policy]:
        """Those to show: the reference, the best, and for contrast the worst."""
        order = [verdict.policy for verdict in ranked(self.evaluation) if verdict.policy in self.policies]
        first = [name for name in order if name == self.evaluation.reference]
        others = [name for name in order if name not in first]
        room = _SHOWN - len(first)
        chosen = first + (others if len(others) <= room else [*others[: room - 1], others[-1]])
        return {name: self.policies[name] for name in order if name in chosen}


def read_subject(path: Path, episodes: int) -> Subject:
    """The subject of a run folder or an evaluation file; a run that has not been judged is judged now.

    Args:
        path: of the folder or the file.
        episodes: per policy, if it is to be judged.

    Raises:
        InputError: nothing is there, or what is there cannot be read or is neither of the two.
    """
    if path.is_dir():
        return _run(path, episodes)
    if not path.exists():
        raise InputError(f"{path} is not there: name a run folder or an evaluation file")
    evaluation = read_evaluation(path)
    found, remarks = _find(evaluation)
    return Subject(evaluation, found, remarks=remarks)


def _run(folder: Path, episodes: int) -> Subject:
    """A run, with its own evaluation if it has one."""
    agent = AgentFile.load(folder)
    curve = read_curve(folder / _CURVE) if (folder / _CURVE).exists() else None
    training: dict[str, Any] = {name: agent.card[name] for name in ("training", "notes") if name in agent.card}
    if (folder / _EVALUATION).exists():
        evaluation = read_evaluation(folder / _EVALUATION)
        policies, remarks = _find(evaluation, folder)
        return Subject(evaluation, policies, curve, training, remarks)
    learned = LearnedPolicy(agent, folder.resolve().name)
    rules = default_policies(agent.scenario)
    flown: list[Policy] = [learned, *(find_policy(name, agent.scenario) for name in rules)]
    evaluation = judge(agent.scenario, flown, episodes)
    evaluation.asked = (str(folder), *rules)
    names = [verdict.policy for verdict in evaluation.verdicts]
    return Subject(evaluation, dict(zip(names, flown, strict=True)), curve, training)


def _find(evaluation: Evaluation, folder: Path | None = None) -> tuple[dict[str, Policy], list[str]]:
    """The policies of an evaluation as far as they can be found again, and what is to be said of the others.

    A run folder may have been moved since: an agent that was flown from a folder of its name is taken from there.
    """
    found: dict[str, Policy] = {}
    lost = []
    for verdict, asked in itertools.zip_longest(evaluation.verdicts, evaluation.asked[: len(evaluation.verdicts)]):
        moved = folder is not None and asked is not None and Path(asked).name == folder.resolve().name
        try:
            found[verdict.policy] = find_policy(str(folder) if moved else asked or "", evaluation.scenario)
        except InputError:
            lost.append(verdict.policy)
    missing = [f"{', '.join(lost)}: not found here, so no flight is shown."] if lost else []
    return found, missing


def configuration(subject: Subject) -> dict[str, str]:
    """Everything needed to make the same again, as text under its title."""
    texts = {"Scenario": subject.scenario.to_yaml()}
    for title, data in subject.training.items():
        texts[title.capitalize()] = json.dumps(data, indent=2, ensure_ascii=False)
    texts["Evaluation"] = json.dumps(subject.evaluation.origin, indent=2, ensure_ascii=False)
    return texts
