"""The command ``passloc``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Annotated, Any

import tyro

from passloc_env.errors import InputError, RenderError
from training.arguments import free_path, parse_overrides, read_scenario
from training.commands import (
    Ablate,
    Bench,
    Card,
    Demo,
    Evaluate,
    Leaderboard,
    List,
    NewScenario,
    Observe,
    Replay,
    Reproduce,
    Seeds,
    Train,
    Tune,
)

Command = (
    Annotated[List, tyro.conf.subcommand("list")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Observe, tyro.conf.subcommand("observe")]
    | Annotated[NewScenario, tyro.conf.subcommand("new-scenario")]
    | Annotated[Replay, tyro.conf.subcommand("replay")]
    | Annotated[Reproduce, tyro.conf.subcommand("reproduce")]
    | Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Tune, tyro.conf.subcommand("tune")]
    | Annotated[Ablate, tyro.conf.subcommand("ablate")]
    | Annotated[Seeds, tyro.conf.subcommand("seeds")]
    | Annotated[Leaderboard, tyro.conf.subcommand("leaderboard")]
    | Annotated[Card, tyro.conf.subcommand("card")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
)

_DESCRIPTION = (
    "Localise a moving emitter that can only be heard: train agents, judge them, see what can be observed at all."
)
_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit status. Faults of the input are one line on standard error and status 2."""
    command: Any = tyro.cli(Command, prog="passloc", args=arguments, description=_DESCRIPTION)
    try:
        _RUN[type(command)](command)
    except KeyboardInterrupt:
        print("passloc: interrupted", file=sys.stderr)
        return _INTERRUPTED
    except (InputError, RenderError, OSError) as error:
        print(f"passloc: {error}", file=sys.stderr)
        return 2
    return 0


def _list(arguments: List) -> None:
    from training.progress import console
    from training.scenario_list import print_scenarios
    from training.scenario_pages import write_pages

    print_scenarios(console)
    if arguments.pages is not None:
        from training.scenario_films import write_films

        write_pages(arguments.pages)
        write_films(arguments.pages)


def _train(arguments: Train) -> None:
    from training.progress import console
    from training.train import train

    finished = train(arguments)
    console.print(f"trained in {finished.seconds:.0f} s; the agent is in {finished.folder}")


def _evaluate(arguments: Evaluate) -> None:
    from agents import default_policies, find_policy
    from training.judging import judge
    from training.progress import console
    from training.table import rich_table

    scenario = read_scenario(arguments.scenario).override(parse_overrides(arguments.override))
    names = arguments.policies.split(",") if arguments.policies else default_policies(scenario)
    policies = [find_policy(name.strip(), scenario) for name in names]
    target = None if arguments.json is None else free_path(arguments.json)
    evaluation = judge(scenario, policies, arguments.episodes, arguments.seed)
    console.print(rich_table(evaluation, console.width))
    if target is not None:
        evaluation.save(target)


def _demo(arguments: Demo) -> None:
    from training.demo import demo

    demo(arguments)


def _observe(arguments: Observe) -> None:
    from training.observe import observe

    observe(arguments)


def _new_scenario(arguments: NewScenario) -> None:
    from training.starter import new_scenario

    new_scenario(arguments)


def _replay(arguments: Replay) -> None:
    from training.replay import replay

    replay(arguments)


def _reproduce(arguments: Reproduce) -> None:
    from training.reproduce import reproduce

    reproduce(arguments)


def _tune(arguments: Tune) -> None:
    from training.tune import tune

    tune(arguments)


def _ablate(arguments: Ablate) -> None:
    from training.ablation import ablate

    ablate(arguments)


def _seeds(arguments: Seeds) -> None:
    from training.seeds import seeds

    seeds(arguments)


def _leaderboard(arguments: Leaderboard) -> None:
    from training.leaderboard import leaderboard

    leaderboard(arguments)


def _card(arguments: Card) -> None:
    from training.card import card

    card(arguments)


def _bench(arguments: Bench) -> None:
    from training.benchmark import run

    run(arguments)


_RUN: dict[type, Callable[[Any], None]] = {
    List: _list,
    Train: _train,
    Evaluate: _evaluate,
    Observe: _observe,
    NewScenario: _new_scenario,
    Replay: _replay,
    Reproduce: _reproduce,
    Demo: _demo,
    Tune: _tune,
    Ablate: _ablate,
    Seeds: _seeds,
    Leaderboard: _leaderboard,
    Card: _card,
    Bench: _bench,
}


if __name__ == "__main__":
    sys.exit(main())
