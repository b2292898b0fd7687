"""Watching policies fly the same episode side by side; ``passloc replay``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from agents import Policy, find_policy
from passloc_env.errors import InputError
from passloc_env.rendering.canvas import Canvas
from passloc_env.rendering.frame import draw_frame
from passloc_env.rendering.record import Instant, Recorder
from passloc_env.rendering.renderer import FRAMES_PER_SECOND
from passloc_env.rendering.window import Window
from passloc_env.scenario import Scenario
from passloc_env.vector_env import LocalisationVectorEnv
from training.arguments import check_seed, free_path, parse_overrides, read_scenario
from training.commands import Replay
from training.episodes import decide
from training.progress import console, progress_bar

_HELD = 15
"""Frames for which the end is shown."""


def replay(arguments: Replay) -> list[Path]:
    """Fly the episode, and show it in a window unless files are asked for; the files.

    Raises:
        InputError: an unknown scenario or policy, a negative seed, or a file that does not end as it should.
        OSError: a place that cannot be written into; told before anything is flown.
        RenderError: no file is asked for, and there is no display.
    """
    check_seed(arguments.seed)
    scenario = read_scenario(arguments.scenario).override(parse_overrides(arguments.override))
    policies = [find_policy(name.strip(), scenario) for name in arguments.policy.split(",")]
    wanted = {ending: getattr(arguments, ending) for ending in ("gif", "mp4", "html")}
    files: dict[str, Path] = {ending: path for ending, path in wanted.items() if path is not None}
    for ending, path in files.items():
        if path.suffix.lower() != f".{ending}":
            raise InputError(f"{ending} = {str(path)!r} is not possible: must end in .{ending}")
        free_path(path)
    if not files:
        _show(scenario, policies, arguments.seed)
        return []
    for path in _write(files, scenario, policies, arguments.seed):
        console.print(f"    {path}", highlight=False, soft_wrap=True)
    return list(files.values())


def _write(files: dict[str, Path], scenario: Scenario, policies: Sequence[Policy], seed: int) -> Iterator[Path]:
    """Write what was asked for; each file once it is whole."""
    if "html" in files:
        from training.report.episode_page import write_episode

        write_episode(files["html"], scenario, policies, seed)
        yield files["html"]
    films = {ending: path for ending, path in files.items() if ending != "html"}
    if films:
        from training.film import write_gif, write_mp4

        frames = _flown(scenario, policies, seed)
        frames += [frames[-1]] * _HELD
        for ending, path in films.items():
            {"gif": write_gif, "mp4": write_mp4}[ending](path, frames, FRAMES_PER_SECOND)
            yield path


def fly(scenario: Scenario, policy: Policy, seed: int) -> Iterator[Canvas]:
    """Pictures of an episode: the first look, then one after each decision until it ends."""
    flown = scenario.override(dict(policy.overrides))
    for instants in episode(flown, policy, seed):
        yield draw_frame(flown, instants, policy.name)


def record(scenario: Scenario, policy: Policy, seed: int) -> list[Instant]:
    """An episode from its first look to its end, one instant per sensor step."""
    *_, instants = episode(scenario.override(dict(policy.overrides)), policy, seed)
    return instants


def episode(flown: Scenario, policy: Policy, seed: int) -> Iterator[list[Instant]]:
    """What has happened in an episode, at its first look and after each decision until it ends."""
    env = LocalisationVectorEnv(1, flown, autoreset_mode=AutoresetMode.DISABLED)
    recorder = Recorder(env.batch.tiles[0], 0)
    observation, _ = env.reset(seed=seed)
    rng, ended = np.random.default_rng(seed), False
    yield recorder.look()
    while not ended:
        observation, _, terminated, truncated, _ = env.step(decide(policy, env, observation, rng))
        ended = bool(terminated[0] or truncated[0])
        yield recorder.look()


def side_by_side(flights: Sequence[Iterator[Canvas]]) -> Iterator[np.ndarray]:
    """Pictures ``(height, Σ width, 3)``; who has ended waits for the others."""
    last: list[Any] = [None] * len(flights)
    while True:
        latest = [next(flight, None) for flight in flights]
        if all(canvas is None for canvas in latest):
            return
        last = [before if canvas is None else canvas.pixels() for canvas, before in zip(latest, last, strict=True)]
        yield np.concatenate(last, axis=1)


def _flown(scenario: Scenario, policies: Sequence[Policy], seed: int) -> list[np.ndarray]:
    frames = []
    decisions = scenario.episode.steps // scenario.episode.decision_every
    with progress_bar("decisions") as bar:
        task = bar.add_task(f"flying {scenario.name}", total=1 + decisions)
        for frame in side_by_side([fly(scenario, policy, seed) for policy in policies]):
            frames.append(frame)
            bar.advance(task)
        bar.update(task, completed=1 + decisions)
    return frames


def _show(scenario: Scenario, policies: Sequence[Policy], seed: int) -> None:
    window: Window | None = None
    for frame in side_by_side([fly(scenario, policy, seed) for policy in policies]):
        if window is None:
            height, width = frame.shape[:2]
            window = Window(f"{scenario.name}, seed {seed}", width, height, "name a file with --gif or --mp4")
        if not window.show(frame, FRAMES_PER_SECOND):
            break
    if window is not None:
        window.wait()
