"""The demo: train, judge against the rules, show."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from agents import LearnedPolicy, default_policies, find_policy
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import at_least_one, new_folder
from training.commands import Demo
from training.evaluate import Evaluation
from training.hyperparameters import Hyperparameters
from training.judging import judge
from training.pictures import draw_learning_curve, draw_tracks
from training.progress import console
from training.report import report_page, write_report
from training.report.subject import read_subject
from training.table import markdown_table, notes, rich_table, title
from training.train import Run, run

_SCENARIO = "BearingsOnly"
_SHOWN = ("straight", "circle", "zigzag:angle=60")
"""Rules drawn beside the agent."""


def demo(arguments: Demo) -> Evaluation:
    """Train a few minutes, evaluate on unseen seeds, print the table, save it and the pictures."""
    scenario = find(_SCENARIO)
    parameters = Hyperparameters.for_scenario(scenario.name)
    parameters = dataclasses.replace(parameters, decisions=arguments.decisions)
    at_least_one(episodes=arguments.episodes)
    folder = new_folder(arguments.out, "demo")
    console.print(f"1/3 training PPO for {parameters.decisions:,} decisions on {scenario.name} …")
    finished = run(scenario, parameters, folder, arguments.seed)
    console.print(f"    {finished.seconds:.0f} s; the agent is in {folder}")

    console.print(f"2/3 judging it against the rules on {arguments.episodes} unseen episodes …")
    agent = LearnedPolicy(finished.agent, name="learned (PPO)")
    rules = [find_policy(name, scenario) for name in default_policies(scenario)]
    evaluation = judge(scenario, [agent, *rules], arguments.episodes)
    console.print(rich_table(evaluation, console.width))

    console.print("3/3 drawing …")
    for path in _save(folder, finished, evaluation, agent, scenario):
        console.print(f"    {path}")
    return evaluation


def _save(folder: Path, finished: Run, evaluation: Evaluation, agent: LearnedPolicy, scenario: Scenario) -> list[Path]:
    """Write table, results, pictures and the report; what was written."""
    table, results = folder / "table.md", folder / "evaluation.json"
    table.write_text(f"{title(evaluation)}\n\n{markdown_table(evaluation)}\n{notes(evaluation)}\n", encoding="utf-8")
    evaluation.asked = (str(folder), *default_policies(scenario))
    evaluation.save(results)
    tracks, curve = folder / "tracks.png", folder / "learning_curve.png"
    draw_tracks(scenario, [agent, *(find_policy(name, scenario) for name in _SHOWN)], evaluation.seed, tracks)
    draw_learning_curve(finished, evaluation, curve)
    page = folder / "report.html"
    write_report(report_page(read_subject(folder, evaluation.episodes)), page)
    return [table, results, tracks, curve, page]
