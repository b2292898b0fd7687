"""Paper 002: bearing and radial acceleration at one fixed station (Feng, Li, Zhou, Sun), claim by claim.

The algebra is measured on random tracks against the rows that the paper differentiates; the simulation of its section 3
is the registered scenario flown by a fixed station. What the paper leaves open is an assumption: 300 s of one look a
second, an inbound target, a first guess of the range good to 20 % and of the velocity to 50 m/s per axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from passloc_env.arrays import Array
from passloc_env.observability import (
    bearing_radial_acceleration_gram_determinant,
    degree_of_observability,
    radial_acceleration_gram_determinant,
    track_state_rows,
)
from passloc_env.rendering.colours import BOUND, EMITTER, ESTIMATE, OBSERVER
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.target import PolarStart
from passloc_env.tracking import ScatteredPrior, UnscentedKalman
from passloc_env.tracking.radial_acceleration import solve_track
from passloc_env.units import DEGREE, KILOMETRE
from training.papers.comparison import (
    CONVERGED,
    CRITERIA,
    EFFICIENT,
    HEADINGS,
    MOVING,
    STUCK,
    error_ratio,
    fixed_against_moving,
    row,
)
from training.papers.monte_carlo import History, run
from training.papers.reproduction import Reproduction, Verdict, holds

_RANGE = 200 * KILOMETRE
_ANGLES, _SPEEDS = (0.0, 45.0, 60.0), (200.0, 350.0)
_END = 300
_LONG = 900
_COLOURS = {0.0: EMITTER, 45.0: OBSERVER, 60.0: ESTIMATE}
_WIDTHS = {200.0: 1.1, 350.0: 2.4}


@dataclass(frozen=True)
class Setting:
    """One of the paper's targets: angle φ between track and line of sight, degrees; speed, m/s; which way it goes."""

    angle: float
    speed: float
    receding: bool = False

    @property
    def label(self) -> str:
        """As in the legend of the paper's fig. 3."""
        return f"φ = {self.angle:g}°, {self.speed:g} m/s"

    def scenario(self, steps: int = _END) -> Scenario:
        """The registered scenario with this target, which starts due north at 200 km, and the assumed prior."""
        course = self.angle + (0.0 if self.receding else 180.0)
        return SCENARIOS["RadialAcceleration"].override(
            {
                "target.start": PolarStart(range=_RANGE, speed=self.speed, course=course * DEGREE),
                "prior": ScatteredPrior(range_sigma=0.2 * _RANGE, velocity_sigma=50.0),
                "tracker": UnscentedKalman(),
                "episode.steps": steps,
            }
        )


Histories = Mapping[Setting, History]


def reproduce(reproduction: Reproduction) -> None:
    """Judge every claim of paper 002; by default in 100 runs."""
    _determinants(reproduction)
    _degree(reproduction)
    _three_accelerations(reproduction)
    _two_looks(reproduction)

    runs, seed, engine = reproduction.runs_or(100), reproduction.seed, reproduction.engine
    settings = [Setting(angle, speed) for angle, speed in product(_ANGLES, _SPEEDS)]
    leaving = [Setting(angle, speed, receding=True) for angle, speed in product(_ANGLES, _SPEEDS)]
    paper = {setting: run(setting.scenario(), runs, seed, engine=engine) for setting in settings}
    long = {setting: run(setting.scenario(_LONG), runs, seed, engine=engine) for setting in (*settings, *leaving)}
    _blind(reproduction, paper, long)
    _converging(reproduction, paper, long)
    _orders(reproduction, paper, long)
    _against_the_bound(reproduction, paper, long)
    for blind in settings[: len(_SPEEDS)]:
        title = f"{blind.label}, blind for a fixed station: fixed against moving at 200 to 250 m/s"
        fixed_against_moving(reproduction, title, blind.scenario(), runs, (*MOVING, "fly-at"))
    _draw_scene(reproduction)
    _draw_errors(reproduction, paper)


def _random_tracks(tracks: int = 1000, period: float = 60.0) -> Array:
    """``D, L, v`` ``(3, N)`` of tracks that cross the line of sight, 100 m to 1000 km away and 0.5 m/s to 33 km/s fast.

    In a period they go a tenth of the range or more, so that the rows of neighbouring looks differ in floats as well.
    """
    rng = np.random.default_rng(0)
    size = 10.0 ** rng.uniform(2.0, 6.0, tracks)
    side = rng.choice([-1.0, 1.0], tracks)
    shape = np.stack([side * rng.uniform(0.2, 2.0, tracks), *rng.uniform((-2.0, 0.3), (2.0, 2.0), (tracks, 2)).T])
    return size * shape / np.array([1.0, 1.0, period])[:, None]


def _determinants(reproduction: Reproduction) -> None:
    """Eqs. (10) and (16): the factors, by determinants of the rows (8), (13) and (14)."""
    period = 60.0
    d, along, v = _random_tracks(period=period)
    r0, r1, r2 = (np.hypot(d, along - i * period * v) for i in range(3))
    three = np.linalg.det(np.moveaxis(track_state_rows(d, along, v, period, 3)[:, 0], -1, 0))
    four = np.linalg.det(np.moveaxis(track_state_rows(d, along, v, period, 2, bearings=True).reshape(4, 4, -1), -1, 0))
    alone = three / (d**7 * v**8 * period**3 / (r0 * r1 * r2) ** 5)
    both = four / (d**4 * v**5 * period**2 / (r0 * r1) ** 5)
    law = _largest(three / radial_acceleration_gram_determinant(d, along, v, period) - 1.0)
    law_of_both = _largest(four / bearing_radial_acceleration_gram_determinant(d, along, v, period) - 1.0)
    where = f"{len(d)} random tracks, 100 m to 1000 km, 60 s between looks; D ≠ 0 and v ≠ 0"
    reproduction.claim(
        "(10): the factor of D⁷v⁸T³/(r_k r_{k−1} r_{k−2})⁵ in the determinant of three radial accelerations",
        -42.0,
        round(float(np.median(alone)), 9),
        holds(_largest(alone / -42.0 - 1.0) < 1e-9),
        f"{where}; −18 holds to {law:.0e} relative for every T, the powers are right, 42 is a misprint",
    )
    reproduction.claim(
        "(16): the factor of D⁴v⁵T²/(r_k r_{k−1})⁵ in the determinant of two bearings and radial accelerations",
        -3.0,
        round(float(np.median(both)), 9),
        holds(_largest(both / -3.0 - 1.0) < 1e-9),
        f"{where}; holds to {law_of_both:.0e} relative for every T",
    )


def _degree(reproduction: Reproduction) -> None:
    """Eq. (11): the degree of observability of looks close together, by its slope over the aspect."""
    aspect = np.linspace(5.0, 85.0, 33) * DEGREE
    speed, period = 200.0, 1e-3
    exact = np.abs(
        radial_acceleration_gram_determinant(_RANGE * np.sin(aspect), -_RANGE * np.cos(aspect), speed, period)
    )
    unit = (speed / _RANGE) ** 8 * period**3
    power, logarithm = np.polyfit(np.log(np.sin(aspect)), np.log(exact / unit), 1)
    printed = 42.0 * np.cos(aspect) ** 7 * unit
    steep, flat = (int(np.argmin(np.abs(aspect - angle * DEGREE))) for angle in (60.0, 45.0))
    deviation = _largest(exact / degree_of_observability(_RANGE, speed, aspect, period) - 1.0)
    reproduction.claim(
        "(11): for small T the degree of observability is 42 (v/r)⁸ T³ cos⁷φ, φ between track and line of sight",
        "42, cos⁷",
        f"{np.exp(logarithm):.4f}, sin^{power:.4f}",
        holds(_largest(exact / printed - 1.0) < 1e-3),
        f"φ of 5° to 85°, vT/r = 1e-6; 18 sin⁷φ holds to {deviation:.0e}. As printed, 60° would be "
        f"{printed[flat] / printed[steep]:.0f} times worse than 45°; it is {exact[steep] / exact[flat]:.1f} times "
        "better, as the paper's text says",
    )


def _three_accelerations(reproduction: Reproduction) -> None:
    """Conclusion 1: three radial accelerations give range and speed."""
    d, along, v = _random_tracks()
    found = solve_track(_accelerations(d, along, v, 60.0, (2, 1, 0)), 60.0)
    error = _largest((found.state - np.stack([np.abs(d), along, v])) / np.stack([np.abs(d), np.hypot(d, along), v]))
    # What three looks are worth with the paper's noise, in its best setting and spread over the whole record.
    speed, aspect, period = 350.0, 60.0 * DEGREE, 150.0
    truth = np.array([[_RANGE * np.sin(aspect)], [2.0 * period * speed - _RANGE * np.cos(aspect)], [speed]])
    noise = 0.1 * np.random.default_rng(0).standard_normal((3, 10_000))
    noisy = solve_track(_accelerations(truth[0], truth[1], truth[2], period, (2, 1, 0)) + noise, period)
    off = np.hypot(*noisy.state[:2, noisy.sound]) / np.hypot(*truth[:2]) - 1.0
    reproduction.claim(
        "Conclusion 1: three radial accelerations determine |D|, L and v of a track that is not radial",
        "uniquely",
        f"closed form, largest relative error {error:.0e}",
        holds(bool(found.sound.all()) and error < 1e-6),
        "1000 random tracks without noise, 60 s between looks. Not a way to locate: with 0.1 m/s², φ = 60°, 350 m/s "
        f"and looks 150 s apart {_percent(noisy.sound.mean())} of {noise.shape[1]} draws have a solution, its range "
        f"off by {_percent(np.median(np.abs(off)))} in the median; filters live on many looks together",
    )


def _two_looks(reproduction: Reproduction) -> None:
    """Conclusion 2: two bearings and radial accelerations give the whole state."""
    d, along, v = _random_tracks()
    normal = np.random.default_rng(1).uniform(-np.pi, np.pi, d.shape)
    bearings = np.arctan2(along - 60.0 * v * np.array([1.0, 0.0])[:, None], d) + normal
    found = track_of_two_looks(bearings, _accelerations(d, along, v, 60.0, (1, 0)), 60.0)
    error = found - np.stack([d, along, v, normal])
    error[3] = np.angle(np.exp(1j * error[3]))
    largest = _largest(error / np.stack([np.abs(d), np.hypot(d, along), v, np.ones(len(d))]))
    reproduction.claim(
        "Conclusion 2: two bearings and two radial accelerations determine D, L, v and φ of a track that is not radial",
        "uniquely",
        f"closed form, largest relative error {largest:.0e}",
        holds(largest < 1e-6),
        "1000 random tracks without noise, on both sides, 60 s between looks",
    )


def track_of_two_looks(bearings: Array, accelerations: Array, period: float) -> Array:
    """The straight track with two given bearings and radial accelerations, in closed form.

    With the angle ψ from the track's normal, ``r = D/cos ψ`` and ``a = v² cos³ψ/D``. The accelerations give
    ``ρ = (a₁/a₀)^{1/3} = cos ψ₁/cos ψ₀`` and the bearings ``ψ₁ − ψ₀ = Δ``, so ``tan ψ₀ = (cos Δ − ρ)/sin Δ``; then
    ``D (tan ψ₁ − tan ψ₀) = v T`` and the latest acceleration give D and v (paper 002, eqs. 4 and 12).

    Args:
        bearings: ``(2, N)``, rad, oldest first; they differ.
        accelerations: ``(2, N)``, m/s², above zero.
        period: time between the looks, s.

    Returns:
        ``D, L, v`` and the direction φ of the normal at the latest look ``(4, N)``; D has the sign of Δ.
    """
    turn = np.angle(np.exp(1j * (bearings[1] - bearings[0])))
    ratio = np.cbrt(accelerations[1] / accelerations[0])
    before = (np.cos(turn) - ratio) / np.sin(turn)
    # tan ψ₁ by the same elimination from the other end: the addition theorem would lose digits near a right angle.
    after = (1.0 / ratio - np.cos(turn)) / np.sin(turn)
    side = np.sign(turn)
    secant = np.hypot(1.0, after)
    distance = side * accelerations[1] * (period * secant / (after - before)) ** 2 * secant
    speed = distance * (after - before) / period
    along = distance * after
    state: Array = np.stack([distance, along, speed, bearings[1] - np.arctan2(along, distance)])
    return state


def _accelerations(d: Array, along: Array, v: Array, period: float, ages: tuple[int, ...]) -> Array:
    """``D² v²/r³`` of eq. (4), so many periods ago, ``(len(ages), N)``."""
    ranges = np.hypot(d, along - period * v * np.array(ages, float)[:, None])
    radial: Array = np.square(d * v) / ranges**3
    return radial


def _blind(reproduction: Reproduction, paper: Histories, long: Histories) -> None:
    """φ = 0 does not converge."""
    for speed in _SPEEDS:
        here, leaving = paper[Setting(0.0, speed)], long[Setting(0.0, speed, receding=True)]
        kept, metres = error_ratio(here.relative_error[-1], here.relative_error[0]), here.rms()[-1] / here.rms()[0]
        bound = here.relative_bound[-1] / here.relative_bound[0]
        reproduction.claim(
            f"φ = 0°, {speed:g} m/s: the error does not converge (RMS of the relative range error, end over start)",
            "does not converge",
            kept,
            holds(min(kept.value, bound, metres) >= STUCK),
            f"{CRITERIA}; inbound, {_END} s. The bound's ratio is {bound:.2f}, the RMS in metres' {metres:.2f}: "
            "most of the growth is the shrinking range. Receding, the relative RMS falls with the growing range alone, "
            f"to {_percent(leaving.relative_rms[-1])} after {_LONG} s; in metres it grows to "
            f"{leaving.rms()[-1] / leaving.rms()[0]:.1f} times its start",
        )


def _converging(reproduction: Reproduction, paper: Histories, long: Histories) -> None:
    """φ ≠ 0 converges."""
    for angle, speed in product(_ANGLES[1:], _SPEEDS):
        end = paper[Setting(angle, speed)].relative_rms_at(_END)
        leaving = long[Setting(angle, speed, receding=True)]
        then = leaving.at(_END)
        # Whether it holds further is read off the bound, which is the same in all runs.
        away = leaving.relative_bound[then]
        reproduction.claim(
            f"φ = {angle:g}°, {speed:g} m/s: the error converges (RMS of the relative range error after {_END} s)",
            "converges",
            end,
            _verdict(end.value < CONVERGED, away < CONVERGED),
            f"{CRITERIA}; inbound, {_END} s. Receding, the signal falls with the range: the bound ends at "
            f"{_percent(away)} and the RMS at {_percent(leaving.relative_rms[then])}, after {_LONG} s at "
            f"{_percent(leaving.relative_bound[-1])} and {_percent(leaving.relative_rms[-1])}",
        )


def _orders(reproduction: Reproduction, paper: Histories, long: Histories) -> None:
    """60° better than 45°, 350 m/s better than 200 m/s, and until when."""
    pairs = {f"60° is better than 45° at {v:g} m/s": (Setting(60.0, v), Setting(45.0, v)) for v in _SPEEDS} | {
        f"350 m/s is better than 200 m/s at {angle:g}°": (Setting(angle, 350.0), Setting(angle, 200.0))
        for angle in _ANGLES[1:]
    }
    for claim, pair in pairs.items():
        ratio = error_ratio(*(paper[setting].relative_error[-1] for setting in pair))
        inbound = _reversal(*(long[setting] for setting in pair))
        receding = _reversal(*(long[replace(setting, receding=True)] for setting in pair))
        reason = "" if inbound is None else "; about then the 45° track passes closest, and closer"
        reproduction.claim(
            f"{claim} (ratio of the RMS errors after {_END} s)",
            "below 1",
            ratio,
            _verdict(ratio.value < 1.0, inbound is None and receding is None),
            f"inbound, {_END} s. In the bounds the order reverses {_when(inbound)} inbound and {_when(receding)} "
            f"receding{reason}",
        )


def _reversal(better: History, worse: History) -> float | None:
    """When the bound of what is better first exceeds the other's, s; None when it never does."""
    later = np.flatnonzero(better.relative_bound > worse.relative_bound)
    return float(better.time[later[0]]) if len(later) else None


def _when(reversal: float | None) -> str:
    return f"never within {_LONG} s" if reversal is None else f"after {reversal:.0f} s"


def _verdict(holds_here: bool, holds_further: bool) -> Verdict:
    """Reproduced only if …, for what holds in the paper's setting but not beyond."""
    return Verdict.REPRODUCED_IF if holds_here and not holds_further else holds(holds_here)


def _against_the_bound(reproduction: Reproduction, paper: Histories, long: Histories) -> None:
    """How close the tracker comes to the bound, whether it knows its errors, and what longer records bring."""
    low, high = EFFICIENT
    rows = []
    for setting, history in paper.items():
        inside = "yes" if low <= history.efficiency[-1] <= high else "no"
        rows.append((*row(setting.label, history), inside if setting.angle else "not observable"))
    title = f"The fixed station after {_END} s, inbound"
    reproduction.table(title, ("target", *HEADINGS[1:], f"RMS / bound in {low}–{high}"), rows)
    later = [
        row(f"{setting.label}, {'receding' if setting.receding else 'inbound'}", history)
        for setting, history in long.items()
    ]
    title = f"The fixed station after {_LONG} s; an inbound target at φ = 0° flies at the station"
    reproduction.table(title, ("target", *HEADINGS[1:]), later)


def _percent(share: float) -> str:
    """Three digits of what is small, none behind the point of what is large."""
    return f"{100 * share:.3g} %" if share < 1.0 else f"{100 * share:.0f} %"


def _draw_scene(reproduction: Reproduction) -> None:
    """Fig. 2: the tracks."""
    caption = (
        f"The targets of the paper's fig. 2, {_END} s inbound from 200 km; dots mark where 200 m/s and 350 m/s have "
        "come to."
    )
    with reproduction.figure("scene", caption, size=(4.4, 4.4)) as axes:
        for angle in _ANGLES:
            reach = np.array([0.0, *_SPEEDS]) * _END / KILOMETRE
            east, north = -reach * np.sin(angle * DEGREE), _RANGE / KILOMETRE - reach * np.cos(angle * DEGREE)
            axes.plot(east, north, "o-", color=_COLOURS[angle], ms=5, lw=2, markevery=(1, 1), label=f"φ = {angle:g}°")
            # Above the outermost track, to the right of the others: clear of all lines.
            offset, side = ((-5, 5), "right") if angle == max(_ANGLES) else ((7, -2), "left")
            for speed, *place in zip(_SPEEDS, east[1:], north[1:], strict=True):
                axes.annotate(f"{speed:g} m/s", place, offset, textcoords="offset points", size=8, ha=side)
        axes.plot(0.0, 0.0, "^", color=BOUND, ms=9, ls="none", label="station")
        axes.set(xlabel="east, km", ylabel="north, km", xlim=(-150.0, 80.0), ylim=(-10.0, 215.0))
        axes.set_aspect("equal")
        axes.grid(alpha=0.3)
        axes.legend(loc="lower left")


def _draw_errors(reproduction: Reproduction, paper: Histories) -> None:
    """Fig. 3: the relative range error over time in all six settings."""
    caption = (
        "The paper's fig. 3: RMS of the relative range error over time in six settings (solid), and the Cramér–Rao "
        "bound (dashed); thin 200 m/s, thick 350 m/s."
    )
    with reproduction.figure("errors", caption, size=(7.0, 4.6)) as axes:
        for setting, history in paper.items():
            style = {"color": _COLOURS[setting.angle], "lw": _WIDTHS[setting.speed]}
            axes.semilogy(history.time, 100.0 * history.relative_rms, label=setting.label, **style)
            axes.semilogy(history.time, 100.0 * history.relative_bound, ls="--", alpha=0.7, **style)
        axes.plot([], [], "--", color=BOUND, label="bound")
        axes.set(xlabel="time, s", ylabel="relative range error, %", xlim=(0.0, _END), ylim=(0.5, 100.0))
        axes.grid(alpha=0.3, which="both")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def _largest(values: Array) -> float:
    """The largest magnitude."""
    return float(np.abs(values).max())
