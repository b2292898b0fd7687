"""What Gymnasium asks of an environment, for every registered id."""

import copy
import importlib
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import passloc_env
from passloc_env import SCENARIOS, LocalisationEnv, LocalisationVectorEnv, Scenario, ScenarioError, observation_names
from passloc_env.batch import TILE
from passloc_env.scenarios import environment_id

IDS = [environment_id(name) for name in SCENARIOS]
ALWAYS = {"reward_terms", "violated"}
DIAGNOSTICS = {"truth", "estimate", "covariance", "nees", "relative_range_error", "bound", "range", "repairs", "gated"}


@pytest.mark.parametrize("identifier", IDS)
@pytest.mark.parametrize("diagnostics", [False, True])
def test_check_env(identifier, diagnostics, monkeypatch):
    """Every render mode is tried; a window needs a display, SDL's dummy is one."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gymnasium.make(identifier, diagnostics=diagnostics).unwrapped
    assert env.spec.id == identifier
    check_env(env)
    check_env(LocalisationEnv(identifier, diagnostics=diagnostics), skip_render_check=True)


@pytest.mark.parametrize("identifier", IDS)
def test_registration(identifier):
    spec = gymnasium.spec(identifier)
    assert spec.max_episode_steps is None, "a limit would add a wrapper that ignores an overridden episode"
    assert spec.vector_entry_point is not None
    assert spec.entry_point is not None
    assert not spec.nondeterministic
    assert isinstance(gymnasium.make(identifier).unwrapped, LocalisationEnv)
    assert isinstance(gymnasium.make_vec(identifier, num_envs=2), LocalisationVectorEnv)
    assert isinstance(gymnasium.make_vec(identifier, num_envs=2, vectorization_mode="sync"), SyncVectorEnv)


def test_registration_is_idempotent():
    before = {identifier: gymnasium.spec(identifier) for identifier in IDS}
    passloc_env.register()
    gymnasium.register_envs(passloc_env)
    importlib.reload(passloc_env.registration).register()
    assert {identifier: gymnasium.spec(identifier) for identifier in IDS} == before
    assert all(gymnasium.spec(identifier) is spec for identifier, spec in before.items())


@pytest.mark.parametrize(
    ("kind", "steps"),
    [(LocalisationEnv, 240), (LocalisationVectorEnv, 240), (Scenario, 240)],
)
def test_default_is_bearings_only(kind, steps):
    made = kind()
    scenario = made if isinstance(made, Scenario) else made.scenario
    assert scenario == SCENARIOS["BearingsOnly"]
    assert scenario.episode.steps == steps


def make_scalar(**arguments):
    return gymnasium.make("passloc/BearingDoppler-v0", **arguments)


def make_vector(**arguments):
    return gymnasium.make_vec("passloc/BearingDoppler-v0", num_envs=2, **arguments)


@pytest.mark.parametrize("make", [make_scalar, make_vector])
def test_overrides_are_honoured(make):
    overrides = {"episode.steps": 6, "episode.decision_every": 2, "sensors.Doppler.sigma": 3.0}
    kept = dict(overrides)
    env = make(overrides=overrides)
    assert overrides == kept
    scenario = env.unwrapped.scenario
    assert scenario.episode.steps == 6
    assert scenario.sensors[1].sigma == 3.0
    assert SCENARIOS["BearingDoppler"].sensors[1].sigma == 10.0
    env.reset(seed=0)
    flown = [np.all(env.step(env.action_space.sample())[3]) for _ in range(3)]
    assert flown == [False, False, True]


@pytest.mark.parametrize("make", [make_scalar, make_vector])
@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"episode.stepz": 6}, r"^episode\.stepz = .*did you mean 'steps'"),
        ({"sensors.0.sigma": -1.0}, r"^sensors\.0\.sigma = -1\.0 is not possible: must be above 0 rad"),
        ({"episode.decision_every": 7}, r"^episode\.decision_every = 7 .*must divide steps = 240; closest: "),
        ({"sensors.9.sigma": 1.0}, r"^sensors\.9 = .*known: 0, 1"),
        ({"episode.min_range": 30e3}, r"^episode\.min_range = 30000\.0 .*below the closest start range"),
    ],
)
def test_overrides_are_validated(make, overrides, message):
    with pytest.raises(ScenarioError, match=message) as raised:
        make(overrides=overrides)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("kind", [LocalisationEnv, lambda name: LocalisationVectorEnv(2, name)])
def test_unknown_scenario_names_the_closest(kind):
    with pytest.raises(ScenarioError, match="did you mean 'BearingsOnly'"):
        kind("BearingOnly")


@pytest.mark.parametrize("mode", [*AutoresetMode, *(mode.value for mode in AutoresetMode)])
def test_autoreset_mode_is_an_argument_of_each_instance(mode):
    env = gymnasium.make_vec("passloc/BearingsOnly-v0", num_envs=2, autoreset_mode=mode)
    assert env.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert LocalisationVectorEnv.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert LocalisationVectorEnv(2).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


@pytest.mark.parametrize("identifier", IDS)
def test_spec_survives_json(identifier, short, assert_same):
    name = gymnasium.spec(identifier).name
    made = gymnasium.make(identifier, overrides=short(name), diagnostics=True)
    again = gymnasium.make(EnvSpec.from_json(made.spec.to_json()))
    assert again.unwrapped.scenario == made.unwrapped.scenario
    assert_same(again.reset(seed=5), made.reset(seed=5))
    action = made.action_space.sample()
    assert_same(again.step(action), made.step(action))


@pytest.mark.parametrize("identifier", IDS)
def test_vector_spec_survives_json(identifier, short, assert_same):
    name = gymnasium.spec(identifier).name
    made = gymnasium.make_vec(identifier, num_envs=3, overrides=short(name), autoreset_mode="SameStep")
    again = gymnasium.make_vec(EnvSpec.from_json(made.spec.to_json()))
    assert again.num_envs == 3
    assert again.autoreset_mode is AutoresetMode.SAME_STEP
    assert_same(again.reset(seed=5), made.reset(seed=5))


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("name", SCENARIOS)
def test_clones_go_their_own_way(name, clone, short, actions, assert_same):
    """A clone made in mid-episode continues alike, through resets, and stepping it leaves the original alone."""
    env = LocalisationEnv(name, overrides=short(name), diagnostics=True)
    env.reset(seed=4)
    stream = actions(1, env.scenario.action_size)
    env.step(next(stream)[0])
    before, twin = env.get_state(), clone(env)
    assert twin.scenario == env.scenario
    first, second = [next(stream)[0] for _ in range(3)], [next(stream)[0] for _ in range(2)]

    def fly(environment):
        results = [environment.step(first[0]), environment.reset(), environment.step(first[1])]
        return [*results, environment.reset(seed=9), *(environment.step(action) for action in second)]

    flown = fly(twin)
    assert_same(env.get_state(), before)
    assert_same(fly(env), flown)


@pytest.mark.parametrize("name", SCENARIOS)
def test_vector_environments_can_be_copied(name, vector_env, actions, assert_same):
    env = vector_env(3, name)
    env.reset(seed=4)
    stream = actions(3, env.scenario.action_size)
    env.step(next(stream))
    twins = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    for _ in range(8):
        action = next(stream)
        expected = env.step(action)
        for twin in twins:
            assert_same(twin.step(action), expected)


@pytest.mark.parametrize("name", SCENARIOS)
def test_scenarios_can_be_copied_and_written_down(name):
    scenario = SCENARIOS[name]
    twins = [
        copy.deepcopy(scenario),
        pickle.loads(pickle.dumps(scenario)),
        Scenario.from_json(scenario.to_json()),
        Scenario.from_yaml(scenario.to_yaml()),
    ]
    assert twins == [scenario] * 4
    assert LocalisationEnv(scenario.to_dict()).scenario == scenario


@pytest.mark.parametrize("diagnostics", [False, True])
@pytest.mark.parametrize("name", SCENARIOS)
def test_types_and_keys(name, diagnostics):
    env = LocalisationEnv(name, diagnostics=diagnostics)
    keys = ALWAYS | DIAGNOSTICS if diagnostics else ALWAYS
    terms = {term.name for term in env.scenario.reward}
    observation, info = env.reset(seed=0)
    assert info.keys() == keys
    for _ in range(2):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert type(reward) is float
        assert type(terminated) is bool
        assert type(truncated) is bool
        assert (observation.dtype, observation.shape) == (np.float32, env.observation_space.shape)
        assert len(observation_names(env.scenario)) == len(observation)
        assert info.keys() == keys
        assert info["reward_terms"].keys() == terms
        assert type(info["violated"]) is bool
        assert {type(value) for value in info["reward_terms"].values()} == {float}
        weighted = sum(term.weight * info["reward_terms"][term.name] for term in env.scenario.reward)
        assert reward == pytest.approx(weighted, rel=1e-12)


def spoil(value):
    """Overwrite every array and dictionary of a result in place."""
    if isinstance(value, dict):
        for item in value.values():
            spoil(item)
        value.clear()
    elif isinstance(value, (tuple, list)):
        for item in value:
            spoil(item)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        spoil([item for item in value if item is not None])
    elif isinstance(value, np.ndarray) and value.flags.writeable:
        value[...] = 77


@pytest.mark.parametrize("name", SCENARIOS)
def test_spoiling_what_a_scalar_returned_changes_nothing(name, short, actions, assert_same):
    careful, careless = (LocalisationEnv(name, overrides=short(name), diagnostics=True) for _ in range(2))
    careful.reset(seed=1)
    spoil(careless.reset(seed=1))
    stream = actions(1, careful.scenario.action_size)
    for _ in range(6):
        action = next(stream)[0]
        expected, got = careful.step(action), careless.step(action.copy())
        assert_same(got, expected)
        spoil(got)
        if expected[2] or expected[3]:
            got = careless.reset()
            assert_same(got, careful.reset())
            spoil(got)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("size", [3, TILE + 3])
def test_spoiling_what_a_vector_returned_changes_nothing(mode, size, vector_env, actions, assert_same):
    careful, careless = vector_env(size, mode=mode), vector_env(size, mode=mode)
    careful.reset(seed=1)
    spoil(careless.reset(seed=1))
    stream = actions(size)
    for _ in range(6):
        action = next(stream)
        expected, handed = careful.step(action), action.copy()
        got = careless.step(handed)
        assert handed.tobytes() == action.tobytes()
        assert_same(got, expected)
        spoil(got)
        handed[...] = 0.5
    assert_same(careless.get_state(), careful.get_state())


def test_earlier_results_are_left_alone(vector_env, actions, assert_same):
    env, stream = vector_env(3), actions(3)
    results = [env.reset(seed=2)]
    kept = copy.deepcopy(results)
    for _ in range(6):
        results.append(env.step(next(stream)))
        kept.append(copy.deepcopy(results[-1]))
    assert_same(results, kept)


@pytest.mark.parametrize("name", SCENARIOS)
def test_observations_stay_in_their_box(name, vector_env, actions):
    env = vector_env(64, name, "SameStep")
    stream, box = actions(64, env.scenario.action_size), env.observation_space
    observation, _ = env.reset(seed=0)
    assert observation in box
    for _ in range(8):
        observation, _, terminated, truncated, info = env.step(next(stream))
        assert observation in box
        for final in info.get("final_obs", []):
            assert final is None or final in env.single_observation_space
        assert ("final_obs" in info) == (terminated | truncated).any()


@pytest.mark.parametrize("early_end", [True, False])
def test_violation_between_decisions(early_end):
    """An emitter that comes and goes within one decision has violated the range, and ends what ends early."""
    overrides = {
        "platforms.0.heading": 0.5,
        "target.start.range": 2e3,
        "target.start.bearing": 0.5,
        "target.start.course": 0.5 + np.pi,
        "target.start.speed": 300.0,
        "episode.decision_every": 16,
        "episode.min_range": 500.0,
        "episode.lost_error": 1e9,
        "episode.early_end": early_end,
    }
    env = LocalisationEnv(overrides=overrides, diagnostics=True)
    ranges = []
    env.reset(seed=0)
    env._batch_of_one.batch.tiles[0].watchers.append(lambda world: ranges.append(world.outcome.range[0]))
    _, _, terminated, truncated, info = env.step(np.zeros(1, np.float32))
    assert min(ranges) < 500 < info["range"] == ranges[-1]
    assert info["violated"]
    assert (terminated, truncated) == (early_end, False)
    if not early_end:
        _, _, terminated, truncated, info = env.step(np.ones(1, np.float32))
        assert not info["violated"]
        assert not terminated


@pytest.mark.parametrize("early_end", [True, False])
@pytest.mark.parametrize("name", SCENARIOS)
def test_lost_track_ends(name, early_end):
    level = 1e-3 if name == "DualSatellite" else 0.2
    overrides = {"episode.lost_error": level, "episode.early_end": early_end, "episode.min_range": 0.0}
    env = LocalisationVectorEnv(16, name, overrides=overrides, autoreset_mode="Disabled", diagnostics=True)
    env.reset(seed=0)
    _, _, terminated, truncated, info = env.step(np.zeros((16, env.scenario.action_size)))
    lost = info["relative_range_error"] > level
    assert 0 < lost.sum() < 16
    assert terminated.tolist() == (lost & early_end).tolist()
    assert not truncated.any()


@pytest.mark.parametrize("name", SCENARIOS)
def test_time_ends_every_episode(name):
    env = LocalisationEnv(name, overrides={"episode.early_end": False})
    env.reset(seed=0)
    decisions = env.scenario.episode.steps // env.scenario.episode.decision_every
    action = np.full(env.action_space.shape, 0.5, np.float32)
    flags = [env.step(action)[2:4] for _ in range(decisions)]
    assert flags == [(False, False)] * (decisions - 1) + [(False, True)]
