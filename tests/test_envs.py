"""The tracking environments: Gymnasium's rules, what is observed and paid, options, and bad input."""

from __future__ import annotations

import warnings
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RescaleAction
from random_trees import random_tree
from robot_files import urdf

from adaptctl.arrays import Array
from adaptctl.control import MinimumJerk, ReferencePoint
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import (
    Payload,
    Puma560TrackingEnv,
    RewardWeights,
    TrackingEnv,
    VectorTrackingEnv,
)
from adaptctl.envs.task import initial_error_of
from adaptctl.envs.tracking import OPTIONS
from adaptctl.errors import InputError, NonFiniteError, NotFoundError, PhysicalConsistencyWarning
from adaptctl.identifiability import Constraints, constrained
from adaptctl.simulation import SemiImplicitEuler
from adaptctl.simulation.effects import PayloadHeld

PUMA, ANY = "adaptctl.envs:adaptctl/Puma560Tracking-v0", "adaptctl.envs:adaptctl/Tracking-v0"


@pytest.fixture(scope="module")
def measured() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture
def env(measured: Mechanism) -> TrackingEnv:
    return TrackingEnv(measured, 1, duration=0.1, initial_error=0.05)


def checked(env: gymnasium.Env[Any, Any]) -> None:
    """Every warning is an error but one: Gymnasium recommends actions in [-1, 1], and ours are torques in N m."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*For Box action spaces, we recommend")
        with pytest.MonkeyPatch.context() as patch:
            view = SimpleNamespace(show=seen, close=seen)
            patch.setattr("adaptctl.recording.live.Live", lambda mechanism, to, surroundings: view)
            check_env(env.unwrapped)


def seen(*sample: object) -> None:
    """What a live view is given."""


def episode(env: TrackingEnv, seed: int | None, **options: Any) -> tuple[Array, Array]:
    """Observations and rewards of twenty random actions."""
    observations = [env.reset(seed=seed, options=options)[0]]
    actions = np.random.default_rng(7).uniform(-1.0, 1.0, (20, 6)) * [20.0, 20.0, 10.0, 0.02, 0.02, 0.005]
    steps = [env.step(action) for action in actions]
    return np.array(observations + [step[0] for step in steps]), np.array([step[1] for step in steps])


@pytest.mark.parametrize("settings", [{}, {"robot": "puma560_measured", "integrator": SemiImplicitEuler()}])
def test_the_puma_passes_gymnasiums_checks(settings: dict[str, Any]) -> None:
    checked(gymnasium.make(PUMA, **settings))


def test_any_mechanism_passes_gymnasiums_checks() -> None:
    checked(gymnasium.make(ANY, robot=random_tree(3, 4), look_ahead=(), render_mode="rgb_array"))
    checked(gymnasium.make(ANY, robot=urdf("ur5_robot.urdf"), control_period=2e-3))


def test_learners_can_have_normalised_actions() -> None:
    rescaled = RescaleAction(gymnasium.make(PUMA), -1.0, 1.0)
    plain = gymnasium.make(PUMA)
    limits = plain.action_space.high  # type: ignore[attr-defined]
    rescaled.reset(seed=1), plain.reset(seed=1)
    np.testing.assert_allclose(rescaled.step(np.full(6, 0.5))[0], plain.step(0.5 * limits)[0], rtol=1e-12)


def test_environments_run_side_by_side() -> None:
    envs = gymnasium.make_vec("adaptctl/Puma560Tracking-v0", num_envs=2, vectorization_mode="sync")
    envs.reset(seed=3)
    observations, rewards, *_ = envs.step(np.zeros((2, 6)))
    np.testing.assert_array_equal(observations[0], observations[1])
    assert rewards.shape == (2,)
    envs.close()


def test_the_puma_is_as_its_card_says() -> None:
    env = Puma560TrackingEnv()
    np.testing.assert_allclose(env.action_space.high, [97.6, 186.4, 89.4, 24.2, 20.1, 21.3])
    assert env.observation_space.shape == (42,)
    assert (env.steps, env.control_period, env.mechanism.name) == (20000, 1e-3, "puma560")
    observation, info = env.reset()
    where = env.observation_slices
    np.testing.assert_allclose(observation[where["reference_p"]], [0.0, -0.6, 0.8, 0.0, 0.5, 0.0])
    np.testing.assert_allclose(observation[where["p"]] - observation[where["reference_p"]], 0.1, rtol=1e-12)
    np.testing.assert_array_equal(observation[where["v"]], 0.0)
    np.testing.assert_array_equal(info["parameters"], env.mechanism.inertial_parameters)
    t = np.linspace(0.0, 20.0, 4001)
    p, v, _ = env.reference(t)
    limits = [link.joint.limits for link in env.mechanism.links]
    assert np.all(p > [limit.lower for limit in limits])
    assert np.all(p < [limit.upper for limit in limits])
    swing = np.ptp(p[t > 2.0], axis=0)
    assert np.all(swing >= 0.78)
    assert np.abs(v).max() < 1.0


def test_only_a_robot_asked_for_warns_of_impossible_parameters() -> None:
    with pytest.warns(PhysicalConsistencyWarning):
        TrackingEnv("puma560")
    Puma560TrackingEnv(robot="puma560")


@pytest.mark.parametrize("kind", [TrackingEnv, Puma560TrackingEnv])
def test_the_docstring_is_the_card(kind: type[TrackingEnv]) -> None:
    card = kind.__doc__ or ""
    for section in ("Action space", "Observation space", "Reward", "Starting state", "Episode end"):
        assert f"## {section}" in card
    assert "Parameters\n    ----------\n    robot : " in card
    assert all(f"`{option}`" in card for option in OPTIONS)


def test_observations_are_the_state_and_the_reference(env: TrackingEnv) -> None:
    observation, _ = env.reset(seed=0)
    where, reference = env.observation_slices, env.reference
    assert where["look_ahead"].stop == observation.size
    for k in range(3):
        point = reference(1e-3 * k)
        for name in ("p", "v", "a"):
            expected = getattr(point, name)
            np.testing.assert_allclose(observation[where[f"reference_{name}"]], expected, atol=1e-15)
        ahead = np.concatenate([reference(1e-3 * k + delay).p for delay in env.look_ahead])
        np.testing.assert_allclose(observation[where["look_ahead"]], ahead, atol=1e-15)
        before = env.plant.init(observation[where["p"]], observation[where["v"]])
        torque = np.array([3.0, -20.0, 5.0, 0.1, 0.2, -0.1])
        observation, _, _, _, info = env.step(torque)
        after = env.plant.step(before, torque)
        np.testing.assert_array_equal(observation[where["p"]], after.p)
        np.testing.assert_array_equal(observation[where["v"]], after.v)
        assert info["energy"] == pytest.approx(float(env.mechanism.energy(after.p, after.v)), rel=1e-12)
        assert info["time"] == pytest.approx(1e-3 * (k + 1))
        np.testing.assert_array_equal(info["applied_torque"], torque)


def test_the_reward_is_minus_weighted_squares(measured: Mechanism) -> None:
    weights = RewardWeights(position=2.0, velocity=3.0, torque=5.0)
    env = TrackingEnv(measured, 1, initial_error=0.05, reward_weights=weights)
    env.reset()
    torque = np.array([3.0, -20.0, 5.0, 0.1, 0.2, -0.1])
    observation, reward, *_ = env.step(torque)
    part = {name: observation[where] for name, where in env.observation_slices.items()}
    e, rate = part["p"] - part["reference_p"], part["v"] - part["reference_v"]
    expected = -2.0 * e @ e - 3.0 * rate @ rate - 5.0 * np.sum((torque / measured.effort_limits) ** 2)
    assert reward == pytest.approx(expected, rel=1e-12)


def test_equal_seeds_give_equal_bits(measured: Mechanism) -> None:
    first, second = TrackingEnv(measured), TrackingEnv(measured)
    for seed in (4, None, None):  # a new random reference at each reset, the same ones in both
        one, other = episode(first, seed), episode(second, seed)
        assert one[0].tobytes() == other[0].tobytes()
        assert one[1].tobytes() == other[1].tobytes()
    assert not np.array_equal(episode(first, 4)[0], episode(first, None)[0])
    assert not np.array_equal(episode(first, 4)[0], episode(first, 5)[0])


def test_torques_out_of_bounds_are_clipped_and_counted() -> None:
    env = Puma560TrackingEnv()
    limits = env.action_space.high
    env.reset(seed=0)
    counts = [env.step(action)[4]["clipped"] for action in (0.5 * limits, 1.5 * limits, -limits, -7.0 * limits)]
    assert counts == [0, 1, 1, 2]
    env.reset(seed=0)
    clipped, *_, info = env.step(np.array([1e9, 0.0, 0.0, 0.0, 0.0, 0.0]))
    env.reset(seed=0)
    np.testing.assert_array_equal(clipped, env.step(np.array([limits[0], 0.0, 0.0, 0.0, 0.0, 0.0]))[0])
    assert info["applied_torque"][0] == limits[0]


def test_an_episode_is_truncated_at_its_duration(env: TrackingEnv) -> None:
    env.reset()
    ends = [env.step(np.zeros(6))[2:4] for _ in range(100)]
    assert ends[:-1] == [(False, False)] * 99
    assert ends[-1] == (False, True)
    with pytest.raises(ResetNeeded, match="the episode is over"):
        env.step(np.zeros(6))
    env.reset()
    env.step(np.zeros(6))


def test_a_passed_error_bound_terminates(measured: Mechanism) -> None:
    bounds = np.array([0.2, 1.0, 1.0, 1.0, 1.0, np.inf])
    env = TrackingEnv(measured, 1, error_bound=bounds, reward_weights=RewardWeights(termination=77.0))
    env.reset()
    for _ in range(1000):
        observation, reward, terminated, truncated, _ = env.step(np.array([60.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        error = observation[env.observation_slices["p"]] - observation[env.observation_slices["reference_p"]]
        assert terminated == bool(np.any(np.abs(error) > bounds))
        assert (reward <= -77.0) == terminated
        if terminated:
            break
    assert terminated
    assert not truncated


def test_a_payload_is_a_body_on_the_last_link(env: TrackingEnv, measured: Mechanism) -> None:
    center, tensor = [0.01, -0.02, 0.05], np.diag([0.02, 0.03, 0.04])
    _, info = env.reset(seed=0, options={"payload": {"mass": 2.0, "center": center, "inertia": tensor}})
    added = info["parameters"] - measured.inertial_parameters
    np.testing.assert_array_equal(added[:50], 0.0)
    np.testing.assert_allclose(added[50:], from_center_of_mass(2.0, center, tensor), atol=1e-15)
    observation, *_ = env.step(np.zeros(6))
    loaded = TrackingEnv(measured.with_parameters(info["parameters"]), 1, duration=0.1, initial_error=0.05)
    loaded.reset(seed=0)
    np.testing.assert_array_equal(observation, loaded.step(np.zeros(6))[0])
    point = env.reset(options={"payload": 2.0})[1]["parameters"] - measured.inertial_parameters
    np.testing.assert_allclose(point[50:], [2.0, *np.zeros(9)], atol=1e-15)
    np.testing.assert_array_equal(
        env.reset(options={"payload": Payload(2.0)})[1]["parameters"], measured.inertial_parameters + point
    )
    np.testing.assert_array_equal(env.reset()[1]["parameters"], measured.inertial_parameters)


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_a_payload_does_not_keep_to_relations() -> None:
    """Rotors follow the links' parameters, so that the last ten left would be others."""
    geared = load("puma560_geared")
    related = constrained(geared, Constraints({"link1.m": 0.0}))
    single, many = TrackingEnv(related, 1), VectorTrackingEnv(2, robot=related, reference=1)
    for env in (single, many):
        with pytest.raises(InputError, match="payload: puma560_geared has relations among its parameters"):
            env.reset(options={"payload": 1.0})
    with pytest.raises(InputError, match="payload: puma560_geared has relations"):
        TrackingEnv(related, 1, effects=[PayloadHeld(1.0)])


@pytest.mark.filterwarnings("ignore:.*the base floats:adaptctl.errors.SimplificationWarning")
def test_a_payload_finds_its_link_among_those_with_mass() -> None:
    """A floating base's first links own no parameters."""
    floating = load(urdf("ur5_robot.urdf"), floating_base=True)
    own, added = floating.inertial_parameters, from_center_of_mass(2.0, np.zeros(3), np.zeros((3, 3)))
    loaded = TrackingEnv(floating).reset(options={"payload": 2.0})[1]["parameters"]
    np.testing.assert_allclose((loaded - own).reshape(-1, 10)[-1], added, atol=1e-12)
    link = floating.links[-2].name
    held = TrackingEnv(floating, effects=[PayloadHeld(2.0, link=link)]).reset()[1]["parameters"]
    np.testing.assert_allclose((held - own).reshape(-1, 10)[-2], added, atol=1e-12)
    massless = floating.links[0].name
    with pytest.raises(NotFoundError, match=f"unknown link '{massless}'; links: "):
        TrackingEnv(floating, effects=[PayloadHeld(2.0, link=massless)])


def test_true_parameters_can_be_given(env: TrackingEnv, measured: Mechanism) -> None:
    heavier = 1.1 * measured.inertial_parameters
    np.testing.assert_array_equal(env.reset(options={"parameters": heavier})[1]["parameters"], heavier)
    both = env.reset(options={"parameters": heavier, "payload": 1.5})[1]["parameters"]
    assert (both - heavier)[50] == pytest.approx(1.5)


def test_a_trajectory_can_be_given(env: TrackingEnv) -> None:
    path = MinimumJerk(np.array([np.zeros(6), np.ones(6)]), np.array([0.0, 1.0]))
    env.reset(options={"trajectory": path})
    assert env.reference is path
    env.reset(options={"trajectory": 9})
    other = TrackingEnv(env.mechanism, 9)
    other.reset()
    t = np.linspace(0.0, 5.0, 50)
    np.testing.assert_array_equal(env.reference(t).p, other.reference(t).p)
    env.reset(seed=0, options={"trajectory": "random"})
    first = env.reference(t).p
    env.reset(options={"trajectory": "random"})
    assert not np.array_equal(first, env.reference(t).p)


def test_the_initial_error_can_be_given(env: TrackingEnv) -> None:
    for error in (0.2, np.array([0.1, -0.1, 0.2, -0.2, 0.3, 0.0])):
        observation, _ = env.reset(options={"initial_error": error})
        where = env.observation_slices
        off = observation[where["p"]] - observation[where["reference_p"]]
        np.testing.assert_allclose(off, np.broadcast_to(error, 6), atol=1e-15)


def test_what_is_returned_is_the_callers(env: TrackingEnv) -> None:
    observation, info = env.reset(seed=0)
    observation[:], info["parameters"][:] = 9.0, 9.0
    spoiled = env.step(np.zeros(6))[0]
    env.reset(seed=0)
    np.testing.assert_array_equal(spoiled, env.step(np.zeros(6))[0])


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"paylod": 1.0}, NotFoundError, "'paylod'; options: payload, trajectory, initial_error, parameters"),
        ({"payload": -1.0}, InputError, "expected a mass of at least 0 kg, got -1.0"),
        ({"payload": "heavy"}, InputError, "payload: mass: expected a number"),
        ({"payload": {"center": np.zeros(3)}}, InputError, "the mass is missing; entries: mass, center, inertia"),
        ({"payload": {"mass": 1.0, "centre": 0.0}}, NotFoundError, "unknown entry 'centre'"),
        ({"payload": {"mass": 1.0, "center": [0.0, 0.0]}}, InputError, r"payload: center: expected shape \(3,\)"),
        ({"payload": {"mass": 1.0, "inertia": np.diag([1.0, 1.0, 3.0])}}, InputError, "triangle inequality"),
        ({"trajectory": "fast"}, InputError, "expected a Reference, a seed of at least 0, or 'random', got 'fast'"),
        ({"trajectory": -1}, InputError, "trajectory"),
        ({"initial_error": np.zeros(5)}, InputError, "initial_error: expected a number or 6 of them, got shape"),
        (
            {"initial_error": 30.0},
            InputError,
            "initial_error: expected at most a turn in rad .m., got 30: is it in deg",
        ),
        ({"initial_error": float("nan")}, NonFiniteError, "initial_error: expected numbers, got"),
        ({"initial_error": np.inf}, NonFiniteError, r"initial_error: expected finite numbers, got inf at index \(0,\)"),
        ({"parameters": np.zeros(59)}, InputError, r"parameters: expected shape \(60,\), got \(59,\)"),
        ({"parameters": np.full(60, np.nan)}, NonFiniteError, "parameters: expected finite numbers, got nan at index"),
    ],
)
def test_bad_options_are_refused(
    env: TrackingEnv, options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        env.reset(options=options)


@pytest.mark.parametrize(
    ("action", "error", "message"),
    [
        (np.zeros(5), InputError, r"action: expected shape \(6,\), got \(5,\)"),
        (np.zeros((1, 6)), InputError, r"action: expected shape \(6,\), got \(1, 6\)"),
        (3.0, InputError, r"action: expected shape \(6,\), got \(\)"),
        ("left", InputError, "action: expected numbers, got 'left'"),
        (np.zeros(6) + 1j, InputError, "action: expected numbers, got array"),
        ([0.0, 0.0, float("nan"), 0.0, 0.0, 0.0], NonFiniteError, r"torque: expected finite numbers, got nan at"),
        (np.full(6, np.inf), NonFiniteError, "torque: expected finite numbers, got inf"),
    ],
)
def test_bad_actions_are_refused_and_change_nothing(
    env: TrackingEnv, action: Any, error: type[Exception], message: str
) -> None:
    env.reset(seed=0)
    with pytest.raises(error, match=message):
        env.step(action)
    after = env.step(np.zeros(6))[0]
    env.reset(seed=0)
    np.testing.assert_array_equal(after, env.step(np.zeros(6))[0])


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"robot": "puma650"}, NotFoundError, "puma560"),
        ({"duration": 0.0}, InputError, "duration: expected at least one control period of 0.001 s"),
        ({"control_period": -1.0}, InputError, "control_period: expected a positive time"),
        ({"error_bound": np.ones(3)}, InputError, "error_bound"),
        ({"error_bound": float("nan")}, NonFiniteError, "error_bound: expected numbers, got nan"),
        ({"error_bound": -1.0}, InputError, "error_bound: expected positive numbers"),
        ({"torque_limits": np.inf}, InputError, "torque_limits: actions need finite limits"),
        ({"look_ahead": (0.1, float("inf"))}, InputError, "look_ahead"),
        ({"look_ahead": (-0.1,)}, InputError, r"look_ahead: expected times of at least 0 s, got \[-0\.1\]"),
        ({"initial_error": np.inf}, NonFiniteError, "initial_error: expected finite numbers, got inf"),
        ({"reward_weights": 3}, InputError, r"reward_weights: expected RewardWeights\(\.\.\.\), got 3"),
        ({"reward_weights": 0}, InputError, r"reward_weights: expected RewardWeights\(\.\.\.\), got 0"),
        (
            {"reference": "zz"},
            InputError,
            "reference: expected a Reference, a seed of at least 0, or 'random', got 'zz'",
        ),
        ({"reference": -1}, InputError, "reference: expected a Reference, a seed of at least 0, or 'random', got -1"),
        ({"integrator": 3, "substeps": 1}, InputError, "integrator: expected an Integrator, such as RungeKutta4"),
        ({"integrator": SemiImplicitEuler}, InputError, "integrator: expected an Integrator, such as RungeKutta4"),
        ({"effects": 3}, InputError, r"effects: expected a sequence, such as \[ControlDelay\(2\)\], got 3"),
        ({"render_mode": "ansi"}, NotFoundError, "unknown render mode 'ansi'; modes: human, rgb_array"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        TrackingEnv(**settings)


def test_bad_weights_are_refused() -> None:
    with pytest.raises(InputError, match="reward weight of torque: expected a number of at least 0, got -1"):
        RewardWeights(torque=-1.0)
    wrong: Any = "a"
    with pytest.raises(InputError, match="reward weight of position: expected a number, got 'a'"):
        RewardWeights(position=wrong)


def test_a_reference_must_fit(measured: Mechanism) -> None:
    short = MinimumJerk(np.zeros((2, 5)), np.array([0.0, 1.0]))
    with pytest.raises(
        InputError, match=r"expected 6 joints, p, v and a \(n, 6\) at times \(n,\), got \(1, 5\) for n = 1"
    ):
        TrackingEnv(measured, short)
    with pytest.raises(InputError, match="at times"):
        TrackingEnv(measured, lambda t: ReferencePoint(*np.zeros((3, 6))))
    with pytest.raises(InputError, match="reference: expected 3 joints"):
        Puma560TrackingEnv("semi_direct_drive")
    with pytest.raises(InputError, match=r"reference: p: expected shape \(\.\.\., 6\), got \(\d+, 5\)"):
        TrackingEnv(measured).reset(options={"trajectory": short})


def test_calls_in_the_wrong_order_are_refused(measured: Mechanism) -> None:
    env = TrackingEnv(measured, render_mode="rgb_array")
    for call in (lambda: env.step(np.zeros(6)), env.render, lambda: env.reference):
        with pytest.raises(ResetNeeded, match=r"call env.reset\(\) first"):
            call()


def test_an_initial_error_may_be_a_whole_turn() -> None:
    assert initial_error_of(2.0 * np.pi, 2).tolist() == [2.0 * np.pi] * 2
    with pytest.raises(InputError, match="at most a turn"):
        initial_error_of([0.0, -6.2832], 2)


def test_environments_are_registered_without_the_wrappers_that_would_slow_each_step() -> None:
    own = {name: spec for name, spec in gymnasium.registry.items() if name.startswith("adaptctl/")}
    assert len(own) > 5
    for name, spec in own.items():
        assert (spec.order_enforce, spec.disable_env_checker, spec.nondeterministic) == (False, True, False), name
