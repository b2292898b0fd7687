"""Paper 000: bearing and Doppler from one fixed station, against accelerating and turning emitters."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from agents import find_policy
from passloc_env.arrays import Array
from passloc_env.motion import CoordinatedTurn
from passloc_env.observability import (
    augmented_layout,
    augmented_pseudo_linear_rows,
    augmented_transition,
    constant_acceleration_observable,
    coordinated_turn_observable,
    rank_report,
    record_scale,
)
from passloc_env.rendering.colours import BOUND, EMITTER, ESTIMATE, OBSERVER
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.survey import Survey
from passloc_env.units import DEGREE, GIGAHERTZ, SPEED_OF_LIGHT
from training.papers.comparison import HEADINGS, fixed_against_moving, row
from training.papers.monte_carlo import History, run
from training.papers.reproduction import Reproduction, Verdict, holds

CASES = {case: SCENARIOS[f"BearingDopplerCase{case}"] for case in ("1a", "1b", "2a", "2b")}

CONVERGED = 0.01
"""RMS relative error below which a case has converged at the end."""

_SETTINGS = "f0 = 1 GHz, known acceleration or turn rate, no process noise, prior 20 % of range and 50 m/s, 300 s"
_CARRIERS = (1.0, 3.0, 10.0)
_QUIET = 1e-3
"""Factor on the noise of the run without noise."""


def reproduce(reproduction: Reproduction) -> None:
    """Ranks, both corollaries, four cases, sweeps, and the blind cases with observers that move."""
    runs = reproduction.runs_or(100)
    _transition(reproduction)
    _corollaries(reproduction)
    histories = {
        case: run(scenario, runs, reproduction.seed, engine=reproduction.engine) for case, scenario in CASES.items()
    }
    _convergence(reproduction, histories)
    _near_circle(reproduction, histories["2b"], runs)
    _unknown_carrier(reproduction)
    reproduction.table(
        "The fixed station", HEADINGS, [row(f"case {case}", history) for case, history in histories.items()]
    )
    _draw(reproduction, histories)
    for case in ("1b", "2b"):
        title = f"Case {case}: fixed against moving"
        fixed_against_moving(reproduction, title, CASES[case], runs)


def _transition(reproduction: Reproduction) -> None:
    """Eq. 9 against the exponential of the printed and of the corrected matrix."""
    rate, period = 0.5 * DEGREE, 1.0
    layout = CoordinatedTurn(turn_rate=-rate).layout(2)
    ours = CoordinatedTurn(turn_rate=-rate).transition(layout, period)[..., 0]
    corrected = np.zeros((4, 4))
    corrected[0, 2] = corrected[1, 3] = 1.0
    corrected[2, 3], corrected[3, 2] = -rate, rate
    printed = corrected.copy()
    printed[3, 3] = 1.0
    errors = [float(np.abs(_exponential(matrix * period) - ours).max()) for matrix in (corrected, printed)]
    reproduction.claim(
        "eq. 9 is the transition matrix of the printed F_CT",
        "F_CT(4,4) = 1",
        f"largest difference {errors[1]:.2g}; with F_CT(4,4) = 0 {errors[0]:.1g}",
        Verdict.REPRODUCED_IF if errors[0] < 1e-9 < errors[1] else holds(errors[1] < 1e-9),
        "the 1 at (4,4) of F_CT is a misprint for 0",
    )


def _exponential(matrix: Array) -> Array:
    """``exp(A)`` by its Taylor series after 20 halvings, squared back."""
    small, result, term = matrix / 2.0**20, np.eye(len(matrix)), np.eye(len(matrix))
    for order in range(1, 8):
        term = term @ small / order
        result = result + term
    for _ in range(20):
        result = result @ result
    return result


def _five_columns(scenario: Scenario) -> tuple[int, float, Array]:
    """Rank and condition of the form of eq. 14 for the fixed station, and the bearings it sees ``(K,)``."""
    survey = Survey(scenario.override({"platforms.0.speed": 0.0}))
    motion, period = scenario.bound.motion, scenario.episode.period
    states = np.concatenate([survey.start.T, survey.states])
    bearings = np.arctan2(states[:, 0], states[:, 1])
    rows = augmented_pseudo_linear_rows(
        bearings[:, None, None],
        np.zeros((1, 2)),
        survey.layout,
        propagation_speed=SPEED_OF_LIGHT,
        duration=scenario.episode.duration,
    )
    transition = augmented_transition(motion.transition(survey.layout, period))  # type: ignore[attr-defined]
    wider = augmented_layout(survey.layout)
    report = rank_report(rows, transition, wider, record_scale(wider, scenario.episode.duration))
    return int(report.rank[0]), float(report.condition[0]), bearings


def _true_circle() -> Scenario:
    """Case 2b with the speed that makes the track a circle about the station."""
    return CASES["2b"].override({"target.start.velocity": (0.0, 23e3 * 0.5 * DEGREE)})


def _corollaries(reproduction: Reproduction) -> None:
    found = {case: _five_columns(scenario) for case, scenario in {**CASES, "circle": _true_circle()}.items()}
    ranks = {case: rank for case, (rank, _, _) in found.items()}
    one = [bool(constant_acceleration_observable(found[case][2][:, None], tolerance=1e-9)[0]) for case in ("1a", "1b")]
    reproduction.claim(
        "corollary 1: an accelerating emitter is observable iff its bearing changes",
        "1a observable, 1b not",
        f"bearing changes: 1a {one[0]}, 1b {one[1]}; rank of five: 1a {ranks['1a']}, 1b {ranks['1b']}",
        holds(one == [True, False] and (ranks["1a"], ranks["1b"]) == (5, 3)),
        "pseudo-linear form of eq. 14, noise-free bearings",
    )
    turning = {"2a": -3 * DEGREE, "2b": -0.5 * DEGREE, "circle": -0.5 * DEGREE}
    two = {
        case: bool(coordinated_turn_observable(found[case][2][:, None], rate, 1.0, tolerance=1e-9)[0])
        for case, rate in turning.items()
    }
    reproduction.claim(
        "corollary 2: a turning emitter is observable iff the bearing rate differs from the turn rate ω",
        "bearing rate ≠ ω",
        f"rank of five: 2a {ranks['2a']}, 2b {ranks['2b']}, a true circle about the station {ranks['circle']}; the "
        "circle has bearing rate −ω throughout, which the printed condition calls observable",
        Verdict.REPRODUCED_IF if (two["2a"], two["circle"]) == (True, False) and ranks["circle"] == 4 else holds(False),
        "with bearings clockwise and turns counter-clockwise the condition is bearing rate ≢ −ω, as in eq. 24",
    )
    bearings = found["2b"][2]
    stray = float(np.abs(np.unwrap(bearings) - bearings[0] + 0.5 * DEGREE * np.arange(len(bearings))).max())
    reproduction.claim(
        "case 2b circles the station and is unobservable",
        "unobservable",
        f"v/ω = {200.0 / (0.5 * DEGREE):.0f} m against r = 23000 m: rank {ranks['2b']} of 5, condition "
        f"{found['2b'][1]:.3g} (2a: {found['2a'][1]:.3g}); its bearing strays {1e3 * stray:.1f} mrad from a circle's",
        holds(ranks["2b"] < 5),
        "weakly observable by the paper's own theorem; every state counted as a speed, time in records",
    )


def _convergence(reproduction: Reproduction, histories: dict[str, History]) -> None:
    for case in ("1a", "2a"):
        end = histories[case].relative_rms_at(300.0)
        reproduction.claim(
            f"case {case} converges: RMS relative range error at 300 s",
            "converges fast, high accuracy",
            end,
            holds(end.high < CONVERGED),
            f"{_SETTINGS}; converged means below 1 %",
        )
    blind = histories["1b"]
    expected = 0.2 * math.hypot(120e3, 60e3) / blind.range.mean(axis=1)
    gap = float(np.abs(blind.relative_bound / expected - 1.0).max())
    end = blind.relative_rms_at(300.0)
    reproduction.claim(
        "case 1b does not converge: RMS relative range error at 300 s",
        "does not converge, tends to diverge",
        end,
        holds(end.low > 0.2),
        f"{_SETTINGS}; the bound is the prior's 20 % × r0/r(t) within {100.0 * gap:.2g} %: the *relative* error grows "
        "because the emitter comes nearer",
    )


def _near_circle(reproduction: Reproduction, history: History, runs: int) -> None:
    """Case 2b by carrier, process noise, and without noise."""
    end = history.relative_rms_at(300.0)
    reproduction.claim(
        "case 2b does not converge: RMS relative range error at 300 s",
        "does not converge, tends to diverge",
        end,
        Verdict.REPRODUCED_IF if end.low > 0.1 else holds(False),
        f"{_SETTINGS}; falls from 20 % to the bound of {100.0 * history.relative_bound[-1]:.3g} %, no divergence",
    )
    sweep = []
    for carrier in _CARRIERS:
        for noise in (0.0, 1.0):
            sweep.append(_variant(reproduction, f"f0 = {carrier:g} GHz, q = {noise:g} m/s²", carrier, noise, 1.0, runs))
    rows = [row(name, flown) for name, flown in sweep]
    ends = {name: flown.relative_rms_at(300.0).value for name, flown in sweep}
    reproduction.claim(
        "case 2b does not converge: the carrier is not given",
        "does not converge",
        ", ".join(
            f"{carrier:g} GHz {100.0 * ends[f'f0 = {carrier:g} GHz, q = 0 m/s²']:.3g} %" for carrier in _CARRIERS
        ),
        holds(min(end for name, end in ends.items() if "q = 0" in name) > 10.0 * CONVERGED),
        "RMS relative error at 300 s without process noise; above 10 % counts as not converged",
    )
    quiet = {case: _quiet(reproduction, case, runs) for case in ("1b", "2b")}
    rows += [row(f"case {case}, noise / {1 / _QUIET:g}", flown) for case, flown in quiet.items()]
    reproduction.claim(
        "without measurement noise the conclusions are the same",
        "1b and 2b do not converge",
        f"1b {100.0 * quiet['1b'].relative_rms[-1]:.3g} %, 2b {100.0 * quiet['2b'].relative_rms[-1]:.3g} %",
        holds(False) if quiet["2b"].relative_rms[-1] < CONVERGED else Verdict.REPRODUCED,
        f"noise and its model {1 / _QUIET:g} times smaller: 1b stays at the prior, 2b converges",
    )
    reproduction.table("Case 2b by carrier and process noise, and with next to no noise", HEADINGS, rows)


def _variant(
    reproduction: Reproduction, name: str, carrier: float, noise: float, sigma: float, runs: int, case: str = "2b"
) -> tuple[str, History]:
    """A case with another carrier (GHz), process noise (m/s²) and noise."""
    scenario = CASES[case]
    changes: dict[str, Any] = {
        "sensors.Doppler.carrier": carrier * GIGAHERTZ,
        "sensors.Doppler.sigma": 10.0 * sigma,
        "sensors.Bearing.sigma": 3e-3 * sigma,
        "tracker.motion.acceleration_noise": noise,
        "bound.motion.acceleration_noise": noise,
        "target.motion.acceleration_noise": noise,
    }
    return name, run(scenario.override(changes), runs, reproduction.seed, engine=reproduction.engine)


def _quiet(reproduction: Reproduction, case: str, runs: int) -> History:
    return _variant(reproduction, case, 1.0, 0.0, _QUIET, runs, case)[1]


def _unknown_carrier(reproduction: Reproduction) -> None:
    """The carrier as a state, which the five-column form does not have."""
    policy = find_policy("stationary", CASES["1a"])
    found = []
    for case in ("1a", "2a"):
        changes = {**policy.overrides, "sensors.Doppler.carrier_sigma": 10e3}
        survey = Survey(CASES[case].override(changes))
        rank = int(survey.rank().rank[0])
        found.append((case, rank, survey.position_bound[-1] / survey.range[-1]))
    words = ", ".join(f"{case}: rank {rank} of 5, bound {100.0 * bound:.2g} % at 300 s" for case, rank, bound in found)
    reproduction.claim(
        "the conclusions hold with the carrier unknown",
        "f0 unknown",
        words,
        holds(all(rank == 5 for _, rank, _ in found)),
        "f0 stands inside H of eq. 14, so the paper's algebra treats it as known; here it is a state, unknown by "
        "10 kHz, and the rank is that of the Fisher rows",
    )


def _draw(reproduction: Reproduction, histories: dict[str, History]) -> None:
    """The paper's figures 1 and 2: relative range error over time."""
    names = {"1": "accelerating", "2": "turning"}
    for number, kind in names.items():
        caption = f"Figure {number} of the paper: {kind} emitters, RMS relative range error and its bound."
        with reproduction.figure(f"figure_{number}", caption) as axes:
            for letter, colour, style in (("a", ESTIMATE, "--"), ("b", EMITTER, "-")):
                history = histories[f"{number}{letter}"]
                label = f"({letter}) {'observable' if letter == 'a' else 'unobservable'}, by the paper"
                axes.semilogy(history.time, 100.0 * history.relative_rms, style, color=colour, lw=2.0, label=label)
                axes.semilogy(history.time, 100.0 * history.relative_bound, ":", color=BOUND, lw=1.5)
            axes.plot([], [], ":", color=BOUND, lw=1.5, label="Cramér–Rao bounds")
            axes.set_xlabel("time, s")
            axes.set_ylabel("relative range error, %")
            axes.grid(alpha=0.3, which="both")
            axes.legend()
    with reproduction.figure(
        "tracks", "The four cases, seen from the station; dots mark the start.", 1, 4, (3.2, 3.6)
    ) as axes:
        for (case, scenario), panel in zip(CASES.items(), axes[0], strict=True):
            survey = Survey(scenario.override({"platforms.0.speed": 0.0}))
            east, north = np.concatenate([survey.start[:2].T, survey.states[:, :2]]).T / 1e3
            panel.plot(east, north, color=EMITTER, lw=2.0, label="emitter")
            panel.plot(east[0], north[0], "o", color=EMITTER, label="its start")
            panel.plot(0.0, 0.0, "^", color=OBSERVER, ms=8, ls="none", label="station")
            panel.set_aspect("equal", adjustable="datalim")
            panel.set_title(f"case {case}")
            panel.set_xlabel("east, km")
            panel.set_ylabel("north, km")
            panel.grid(alpha=0.3)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        axes[0, 0].figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
