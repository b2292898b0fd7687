"""The reproduction of paper 004: its claims, tables and figures, and the numbers of Table 1 themselves."""

import json
import math
from dataclasses import asdict
from pathlib import Path

import matplotlib.colors
import matplotlib.image
import numpy as np
import pytest

from passloc_env.angles import bearing_of, wrap
from training.papers import cross_fix
from training.papers.cross_fix import LINES, METHODS, RAYS, TANGENT, YARDSTICKS, Trials, reproduce
from training.papers.reproduction import Reproduction, Verdict

RUNS = 3000
STUDY = {
    LINES.name: (0.513, 0.684, 0.799, 0.869),
    RAYS.name: (0.575, 0.765, 0.880, 0.940),
    TANGENT.name: (0.466, 0.630, 0.748, 0.825),
}
"""Shares of errors up to 30, 40, 50 and 60 % of the side, known from an independent study."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Reproduction:
    reproduction = Reproduction("cross-fix", tmp_path_factory.mktemp("figures"), runs=RUNS, seed=5)
    reproduce(reproduction)
    return reproduction


@pytest.mark.parametrize("method", [LINES, RAYS, TANGENT], ids=lambda method: method.name)
def test_table_1(method: cross_fix.Method) -> None:
    """Within 0.006: five standard deviations of 200 000 trials, and room for the study's own three digits."""
    trials = Trials.drawn(200_000, seed=11)
    errors = trials.error(method.locate(trials.stations, trials.bearings))
    shares = [(errors <= limit).mean() for limit in cross_fix.LIMITS]
    np.testing.assert_allclose(shares, STUDY[method.name], atol=0.006)


def test_trials_are_those_of_the_paper() -> None:
    """Uniform places and errors: means and extremes of 300 000 numbers, to five standard deviations of a mean."""
    trials = Trials.drawn(100_000, seed=1)
    for places in (trials.stations, trials.target):
        assert abs(places.mean() - 0.5) < 5.0 * math.sqrt(1.0 / 12.0 / places.size)
        assert 0.0 <= places.min() < 1e-3
        assert 0.999 < places.max() <= 1.0
    error = wrap(trials.bearings - bearing_of(trials.target[:, None] - trials.stations))
    assert abs(error.mean()) < 5.0 * math.sqrt(math.pi**2 / 48.0 / error.size)
    assert math.radians(44.99) < np.abs(error).max() <= math.radians(45.0) + 1e-9
    np.testing.assert_array_equal(trials.error(trials.target), 0.0)


def test_claims(made: Reproduction) -> None:
    assert len(made.claims) == 15
    assert len({claim.claim for claim in made.claims}) == 15
    for claim in made.claims:
        assert claim.paper == "cross-fix"
        assert claim.assumption
        assert isinstance(claim.verdict, Verdict)
        assert json.loads(json.dumps(asdict(claim)))["measured"] == claim.measured
        if isinstance(claim.measured, float):
            assert claim.interval is not None
            low, high = claim.interval
            assert low <= claim.measured <= high
    rows = [claim for claim in made.claims if claim.claim.startswith("Table 1: P")]
    assert [claim.paper_value for claim in rows] == [*LINES.paper, *RAYS.paper]
    for claim, expected in zip(rows, STUDY[LINES.name] + STUDY[RAYS.name], strict=True):
        # Four standard deviations of the few trials, and the study's rounding.
        assert abs(claim.measured - expected) < 4.0 * math.sqrt(expected * (1.0 - expected) / RUNS) + 0.001


def claim_about(made: Reproduction, words: str) -> tuple[object, Verdict]:
    (claim,) = (claim for claim in made.claims if words in claim.claim)
    return claim.measured, claim.verdict


def test_verdicts_that_no_sample_decides(made: Reproduction) -> None:
    """All of these are many standard deviations of 3000 trials from turning; 0.316 ± 0.034 is four of them."""
    share, verdict = claim_about(made, "behind some station")
    assert abs(share - 0.316) < 0.034
    assert verdict is Verdict.REPRODUCED
    share, verdict = claim_about(made, "equivalent")
    assert share > 0.75
    assert verdict is Verdict.NOT_REPRODUCIBLE
    assert claim_about(made, "more accurate")[1] is Verdict.REPRODUCED
    assert claim_about(made, "from tangents (4)")[1] is Verdict.REPRODUCED_IF


@pytest.mark.parametrize(("share", "agrees"), [(0.591, True), (0.578, True), (0.575, False)])
def test_what_agrees_with_the_paper(share: float, agrees: bool) -> None:
    """The paper's 10 000 trials scatter by 0.0049 and 200 000 by 0.0011: 2.73 times both is 0.0138."""
    made = Reproduction("cross-fix", Path())
    errors = np.where(np.arange(200_000) < share * 200_000, 0.25, 0.35)
    cross_fix._claim_row(made, RAYS, errors)
    assert made.claims[0].measured == pytest.approx(share, abs=1e-5)
    assert (made.claims[0].verdict is Verdict.REPRODUCED) == agrees


def test_tables(made: Reproduction) -> None:
    moving, methods, lengths = made.tables
    assert [row[0] for row in moving.rows][:2] == ["stationary, the paper's fix", "stationary"]
    assert [row[0] for row in methods.rows if "paper" not in row[0]] == [m.name for m in METHODS + YARDSTICKS]
    by_name = {row[0]: row[1:] for row in methods.rows}
    for name, expected in STUDY.items():
        # As for the claims, and half a unit of the last digit printed.
        tolerance = 4.0 * math.sqrt(0.25 / RUNS) + 0.0015
        np.testing.assert_allclose([float(cell) for cell in by_name[name][:4]], expected, atol=tolerance)
    assert all(float(by_name[method.name][-1]) > 0.0 for method in METHODS)
    assert by_name[f"{RAYS.name}, paper"][:4] == ("0.591", "0.772", "0.885", "0.939")
    farthest = {(row[0], row[1]): float(row[-1]) for row in lengths.rows}
    for (length, name), value in farthest.items():
        assert value >= farthest["side", name], length


def test_figures(made: Reproduction) -> None:
    assert [figure.file for figure in made.figures] == ["cross-fix_error_probability.png", "cross-fix_false_fix.png"]
    for figure in made.figures:
        assert figure.caption
        picture = matplotlib.image.imread(made.folder / figure.file)[..., :3]
        assert min(picture.shape[:2]) > 300
        for method in METHODS:
            # A line or marker of each colour: at least thirty pixels of it, to a rounding of 8 bits.
            distance = np.abs(picture - matplotlib.colors.to_rgb(method.colour)).max(axis=-1)
            assert (distance < 0.01).sum() > 30, (figure.file, method.name)


def test_a_single_trial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Shares of zero and one, and differences that never vary, still come to a verdict."""
    monkeypatch.setattr(cross_fix, "_TIMED", 10)
    single = Reproduction("cross-fix", tmp_path, runs=1)
    reproduce(single)
    assert len(single.claims) == 15
    assert claim_about(single, "more accurate")[1] is Verdict.NOT_REPRODUCIBLE


def test_seed_decides() -> None:
    first, again, other = (Trials.drawn(10, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first.bearings, again.bearings)
    assert (first.bearings != other.bearings).all()


def test_mean_of_all_that_fits() -> None:
    """Against the same cells with angles in place of products, also where none fits and across a chunk's end."""
    trials = Trials.drawn(cross_fix._CHUNK + 50, seed=2)
    trials.bearings[:, -1] = [bearing_of(station - 0.5) for station in trials.stations[..., -1].T]
    found = cross_fix.mean_of_all_that_fits(trials.stations, trials.bearings)
    middles = (np.arange(cross_fix._CELLS) + 0.5) / cross_fix._CELLS
    cells = np.stack(np.meshgrid(middles, middles)).reshape(2, -1)
    for i in (0, 1, cross_fix._CHUNK - 1, cross_fix._CHUNK, cross_fix._CHUNK + 49):
        angles = bearing_of(cells[:, None] - trials.stations[..., i, None])
        fits = (np.abs(wrap(angles - trials.bearings[:, i, None])) <= cross_fix.WIDEST).all(axis=0)
        expected = cells[:, fits].mean(axis=1) if fits.any() else [0.5, 0.5]
        np.testing.assert_allclose(found[:, i], expected, atol=1e-12)
