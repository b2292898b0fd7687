"""An exported flight is the episode that is judged, and its tables hold it to the last bit."""

import csv
from pathlib import Path

import numpy as np
import pytest

from agents import find_policy
from passloc_env import SCENARIOS, Scenario
from passloc_env.angles import direction
from passloc_env.errors import InputError
from training import episodes
from training.commands import Export
from training.export.command import export
from training.export.flight import Flight, fly
from training.export.tables import tables, write_tables

SHORT = {"episode.steps": 12}
EAR = {"sensors.Bearing.detection_probability": 0.5}


def flown(name: str = "BearingsOnly", policy: str = "circle", seed: int = 3, **changes) -> Flight:
    scenario = SCENARIOS[name].override(changes)
    return fly(scenario, find_policy(policy, scenario), seed)


@pytest.fixture(scope="module")
def deaf() -> Flight:
    """A short flight with half of the bearings."""
    return flown(**SHORT, **EAR)


def read_csv(path: Path) -> dict[str, list[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return dict(zip(header, map(list, zip(*rows, strict=True)), strict=True))


def parsed(words: list[str], like: np.ndarray) -> np.ndarray:
    """A column of words in the type of the column that was written."""
    if like.dtype == bool:
        return np.array([{"true": True, "false": False}[word] for word in words])
    return np.array([word or "nan" for word in words]).astype(like.dtype)


@pytest.mark.parametrize(
    ("name", "policy"), [("BearingsOnly", "random"), ("OwnShipSevere", "circle"), ("DualSatellite", "random")]
)
def test_what_is_exported_is_what_is_judged(name: str, policy: str) -> None:
    scenario = SCENARIOS[name]
    flight = flown(name, policy)
    scores, _ = episodes.fly(scenario, find_policy(policy, scenario), 1, 3)
    assert len(flight.time) == scenario.episode.steps + 1
    assert flight.time[-1] == scenario.episode.duration
    assert flight.relative_range_error[-1] == scores.end_error[0]
    # A mean over a strided axis adds up in another order than one over a contiguous one.
    assert flight.nees[1:].mean() == pytest.approx(scores.mean_nees[0], rel=1e-12)
    bound = np.log(flight.range_bound / flight.range)[1:]
    assert bound.mean() == pytest.approx(scores.log_range_bound[0], rel=1e-12)


def test_an_episode_lasts_its_time_whatever_happens() -> None:
    flight = flown(policy="fly-at", **{"episode.min_range": 19e3, "episode.early_end": True})
    assert (flight.range < 19e3).any()
    assert len(flight.time) == SCENARIOS["BearingsOnly"].episode.steps + 1


@pytest.mark.parametrize("name", SCENARIOS)
def test_measurements_are_those_of_truth_and_poses(name: str) -> None:
    """Noise of the sensor's own size, and no more: mean square within five deviations of one."""
    flight = flown(name, "random")
    error = flight.suite.difference(flight.measurement, flight.suite.measure(flight.scene))
    sigma = np.sqrt(np.einsum("iin->in", flight.suite.noise_covariance))
    squares = np.square(error / sigma)
    assert flight.detected.all()
    np.testing.assert_allclose(squares.mean(axis=1), 1.0, atol=5.0 * np.sqrt(2.0 / len(flight.time)))


def test_truth_moves_as_it_says() -> None:
    """Positions of a straight emitter change by its velocity; the own ship flies where its nose points."""
    flight = flown()
    layout, steps = flight.truth_layout, np.diff(flight.time)
    moved = np.diff(flight.truth[layout.position], axis=-1)
    np.testing.assert_allclose(moved, flight.truth[layout.velocity, 1:] * steps, rtol=1e-9)
    heading = tables(flight)["platforms"]["heading_rad"]
    speed = np.hypot(*flight.poses[0].velocity)
    np.testing.assert_allclose(speed * direction(heading), flight.poses[0].velocity, atol=1e-9)


def test_what_was_not_detected_has_no_value(deaf: Flight) -> None:
    assert 0 < deaf.detected.sum() < deaf.detected.size
    assert (np.isnan(deaf.measurement) == ~deaf.detected).all()


def test_random_numbers_are_those_of_the_episode() -> None:
    sigma = {"type": "LogUniform", "low": 0.001, "high": 0.017}
    changed = {**SHORT, "sensors.Bearing.sigma": sigma}
    noises = [float(flown(seed=seed, **changed).suite.noise_covariance[0, 0, 0]) for seed in (3, 4)]
    assert noises[0] != noises[1]
    assert all(0.001 <= noise**0.5 <= 0.017 for noise in noises)


def test_tables_hold_the_flight(deaf: Flight) -> None:
    made = tables(deaf)
    assert list(made) == ["truth", "platforms", "detections", "tracks"]
    np.testing.assert_array_equal(made["truth"]["north_velocity_m_per_s"], deaf.truth[3])
    np.testing.assert_array_equal(made["platforms"]["reported_east_m"], deaf.reported[0].position[0])
    np.testing.assert_array_equal(made["detections"]["value"], deaf.measurement[0])
    np.testing.assert_array_equal(made["tracks"]["covariance_east_m_north_velocity_m_per_s"], deaf.covariance[0, 3])
    for table in made.values():
        assert list(table)[:2] == ["seed", "time_s"]
        assert (table["seed"] == 3).all()


def test_several_sensors_are_listed_instant_by_instant() -> None:
    flight = flown("DualSatellite", "stationary", **{"episode.steps": 15})
    made = tables(flight)
    detections = made["detections"]
    np.testing.assert_array_equal(detections["time_s"], np.repeat(flight.time, 5))
    np.testing.assert_array_equal(detections["sensor"], np.tile(np.arange(5), 16))
    np.testing.assert_array_equal(detections["value"].reshape(16, 5).T, flight.measurement)
    assert detections["unit"][:5].tolist() == ["rad", "rad", "rad", "rad", "s"]
    assert {"x_m", "z_velocity_m_per_s", "roll_error_0_rad"} <= set(made["truth"])
    second = made["platforms"]["platform"] == 1
    np.testing.assert_array_equal(made["platforms"]["down_z"][second], flight.poses[1].attitude[2, 2])


def test_csv_parquet_and_flight_agree_to_the_last_bit(deaf: Flight, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    for form in ("csv", "parquet"):
        written = write_tables(deaf, tmp_path, form)
        assert [path.name for path in written] == [f"{name}.{form}" for name in tables(deaf)]
    assert len(list(tmp_path.iterdir())) == 8
    for name, table in tables(deaf).items():
        words, stored = read_csv(tmp_path / f"{name}.csv"), parquet.read_table(tmp_path / f"{name}.parquet")
        assert list(words) == stored.column_names == list(table)
        for column, values in table.items():
            np.testing.assert_array_equal(parsed(words[column], values), values)
            back = np.array(stored[column].to_pylist(), None if values.dtype.kind == "U" else values.dtype)
            np.testing.assert_array_equal(back, values)
    missing = parquet.read_table(tmp_path / "detections.parquet")["value"].null_count
    assert missing == (~deaf.detected).sum()


def test_the_command_writes_and_replaces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed in (5, 6):
        export(Export(seed=seed, out=tmp_path / "new", override=("episode.steps=12",)))
        assert set(read_csv(tmp_path / "new" / "truth.csv")["seed"]) == {str(seed)}
    assert len(list((tmp_path / "new").iterdir())) == 4
    assert "truth.csv" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"seed": -1}, "seed = -1 is not possible"),
        ({"policy": "circel"}, "did you mean 'circle'"),
        ({"format": "parkett"}, "did you mean 'parquet'"),
        ({"scenario": "BearingOnly"}, "did you mean 'BearingsOnly'"),
    ],
)
def test_what_cannot_be_exported_is_one_line(changes: dict, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said) as caught:
        export(Export(**{"out": tmp_path / "none", **changes}))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "none").exists()


def test_units_stand_for_every_sensor_and_state() -> None:
    for scenario in SCENARIOS.values():
        made = tables(fly(shortened(scenario), find_policy("stationary", scenario), 0))
        assert (made["detections"]["unit"] != "").all(), scenario.name
        assert made["truth"].keys() & {"east_m", "x_m"}, scenario.name


def shortened(scenario: Scenario) -> Scenario:
    return scenario.override({"episode.steps": scenario.episode.decision_every})
