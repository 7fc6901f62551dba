"""Where simulation begins to do otherwise: sums of errors, sizes of calls, steps of integrators, and touches."""

from __future__ import annotations

import os
from pathlib import Path
from time import perf_counter
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pyarrow.parquet as pq
import pytest
from every_law import ARM, GAIN, slotine_li
from random_trees import random_chain

from adaptctl.compilation.stepper import Source
from adaptctl.control import PDGravity, Sinusoids
from adaptctl.description import Description, Joint, Link
from adaptctl.description.drive import Limits
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.pose import Pose
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation import HandPush, Plant, Rollout, simulate, simulate_many
from adaptctl.simulation.closed_loop import ClosedLoop
from adaptctl.simulation.effects import ElasticJoints, Friction
from adaptctl.simulation.integrator import LinearlyImplicitEuler, RungeKutta4, integration
from adaptctl.simulation.members import validate_single
from adaptctl.simulation.mujoco_plant import TOUCH_FLAGS, MuJoCoPlant, contacts_at
from adaptctl.simulation.reference_limits import _beyond
from adaptctl.simulation.rollout import _measuring, _SteppedRun, _validate_joints
from adaptctl.simulation.rollout_file import CONTROLLER_ARRAYS, SAMPLE_UNITS, RolloutFile
from adaptctl.simulation.run_logger import _validate_memory
from adaptctl.simulation.simulate_many import _Runs
from adaptctl.simulation.summaries import ErrorSums, sum_sizes, summary, summed, watched
from adaptctl.simulation.transmission import Transmission

LAW, PERIODS, FINAL, PERIOD = slotine_li(GAIN), 30, 20, 0.1
SWING = Sinusoids(np.zeros(3), np.full(3, 0.2), np.array([0.5, 0.7, 0.9]))


@pytest.mark.parametrize(("worst", "lost"), [(0.0, None), (3.0, 12), (np.nan, 25), (2.0, None), (3.0, 0)])
def test_errors_are_summed_up_until_one_is_beyond_its_bound(worst: float, lost: int | None) -> None:
    error = np.random.default_rng(0).uniform(-1.0, 1.0, (PERIODS, 2))
    error[13:18] *= 0.25
    error[18:, 0] *= 0.1
    if worst:
        error[12 if lost is None else lost, 1] = worst
    within, beyond = np.array([0.5, 0.7]), np.array([1.5, 2.0])
    held = {"within": Column(within.tolist()), "beyond": Column(beyond.tolist()), "final": Column((float(FINAL),))}
    sums: dict[str, Any] = {name: Column.zeros(size) for name, size in sum_sizes(2).items()}
    for k, row in enumerate(error.tolist()):
        sums = summed(float(k), Column(row), sums | held)._asdict()
    arms = ErrorSums(*(np.array([x.of]) for x in sums.values()))
    found = {name: x[0] for name, x in summary(arms, PERIODS, FINAL, PERIOD, beyond).items()}
    good = error[:lost]
    np.testing.assert_allclose(found["rms_error"], np.sqrt(np.sum(good**2, axis=0) / max(len(good), 1)))
    np.testing.assert_allclose(found["largest_error"], np.abs(good).max(axis=0, initial=0.0))
    late = good[FINAL:]
    np.testing.assert_allclose(
        found["final_rms_error"], np.sqrt(np.mean(late**2, axis=0)) if len(late) else np.full(2, np.nan)
    )
    assert found["diverged_joint"] == (-1 if lost is None else 1)
    assert found["diverged_at"] == pytest.approx(np.nan if lost is None else PERIOD * lost, nan_ok=True)
    outside = np.flatnonzero((np.abs(error) > within).any(axis=1))
    settled = lost is None and outside[-1] + 1 < PERIODS
    assert found["settling_time"] == pytest.approx(PERIOD * (outside[-1] + 1) if settled else np.nan, nan_ok=True)


@pytest.mark.parametrize("arms", [1, 512, 3000])
@pytest.mark.parametrize("numbers", [0, 1, 7, 300, 10**6])
@pytest.mark.parametrize("every", [1, 5])
def test_a_call_takes_eight_megabytes_at_most(arms: int, numbers: int, every: int) -> None:
    run: Any = SimpleNamespace(every=every, parameters=np.zeros((arms, 1)))
    stepper: Any = SimpleNamespace(columns={Source.DRIVEN: {"noise": numbers}}, outputs=[(3,), (2, 2)])
    numbers, together = numbers + (7 if every == 1 else 0), min(arms, 512)
    periods = _Runs._longest(run, stepper)
    fitting = 2**23 // (8 * together * max(numbers, 1))
    assert periods == sorted([1, fitting, 2000])[1]


def test_lyapunovs_function_is_known_of_the_plant_whose_equations_the_law_has() -> None:
    plant = Plant(ARM, 1e-3)
    assert watched(ClosedLoop(plant, LAW), "double") is LAW
    assert watched(ClosedLoop(plant, LAW), "single") is None
    assert watched(ClosedLoop(Plant(random_chain(5, 3), 1e-3), LAW), "double") is None


def test_lyapunovs_function_is_that_of_each_arms_own_gains() -> None:
    """It rises, as periods are too long for these gains."""
    given: Any = {"duration": 0.3, "p": [0.1, -0.2, 0.3], "v": [0.5, 0.0, -0.5], "record_every": None}
    bandwidth = np.array([[80.0, 70.0, 60.0], [90.0, 80.0, 70.0]])
    together = simulate_many(Plant(ARM, 0.05), LAW, SWING, gains={"bandwidth": bandwidth}, **given).lyapunov_rise
    alone = [simulate_many(Plant(ARM, 0.05), LAW.tuned({"bandwidth": own}), SWING, **given) for own in bandwidth]
    np.testing.assert_allclose(together, [run.lyapunov_rise[0] for run in alone], rtol=1e-6)
    assert together[1] > 1.1 * together[0] > 0.0


def test_a_run_has_taken_the_time_of_its_computation() -> None:
    env = TrackingEnv(load("two_link"), Sinusoids(np.zeros(2), np.full(2, 0.1), np.ones(2)), duration=0.05)
    started = perf_counter()
    run = simulate(env, PDGravity(load("two_link"), [100.0, 50.0], [10.0, 5.0]), seed=0)
    assert 0.0 < run.wall_time < perf_counter() - started
    logged = Rollout.from_arrays(run.p, run.torque, run.reference_p, 1e-3)
    assert logged.wall_time == 0.0


def test_a_stretch_without_samples_adds_nothing_to_a_file(tmp_path: Path) -> None:
    def samples(count: int) -> dict[str, Any]:
        joint = ("p", "v", "reference_p", "reference_v", "reference_a", "torque", "applied")
        own = dict.fromkeys(("measured_p", "measured_v")) | dict.fromkeys(CONTROLLER_ARRAYS, np.zeros((count, 0)))
        return dict.fromkeys(joint, np.zeros((count, 1))) | dict.fromkeys(SAMPLE_UNITS, np.zeros(count)) | own

    for counts, groups in (((3, 0, 2), 2), ((0,), 1)):
        with RolloutFile(tmp_path / "run.parquet", 1) as file:
            for count in counts:
                file.append(samples(count), {})
        told = pq.ParquetFile(tmp_path / "run.parquet").metadata
        assert (told.num_rows, told.num_row_groups) == (sum(counts), groups)
        if told.num_rows:  # measured numbers pack well so
            assert set(told.row_group(0).column(0).encodings) == {"RLE", "BYTE_STREAM_SPLIT"}


def test_single_precision_counts_two_to_the_24_periods() -> None:
    loop = ClosedLoop(Plant(ARM, 1e-3), LAW)
    validate_single(loop, 2**24)
    with pytest.raises(InputError, match="counts to 16777216 control periods, got 16777217"):
        validate_single(loop, 2**24 + 1)


@pytest.mark.parametrize("space", [gymnasium.spaces.Dict({}), gymnasium.spaces.Box(0.0, 1.0, (3, 3))], ids=str)
def test_observations_that_are_no_row_of_numbers_are_refused(space: Any) -> None:
    with pytest.raises(InputError, match=r"expected observations of shape \(n,\), got a space of shape"):
        _validate_joints(SimpleNamespace(observation_space=space), LAW, [slice(0, 3)])  # type: ignore[arg-type]


def test_a_state_feels_the_force_and_the_point_that_an_environment_tells() -> None:
    p, told = np.array([0.1, 0.2]), dict(zip(TOUCH_FLAGS, np.arange(1.0, 7.0), strict=True))
    run: Any = SimpleNamespace(_info={"flags": told}, _state="before", _held_state=SimpleNamespace(feeling=tuple_of))
    for applied in ({}, {"applied_torque": np.array([3.0, 4.0])}):
        run._info |= applied
        state, torque, (place, wrench, point) = _SteppedRun._felt(run, tuple_of, p)  # type: ignore[arg-type]
        assert state == "before"
        assert torque.tolist() == (applied["applied_torque"].tolist() if applied else [0.0, 0.0])
        assert (place.tolist(), wrench.tolist(), point.tolist()) == ([0.1, 0.2], [1, 2, 3, 0, 0, 0], [4, 5, 6])
    env: Any = SimpleNamespace(unwrapped=SimpleNamespace(plant=SimpleNamespace(mechanism=ARM)))
    assert _measuring(env, {"flags": told}) is ARM
    blind: Any = SimpleNamespace(unwrapped=SimpleNamespace(plant=SimpleNamespace(mechanism=None)))
    for place, info in ((env, {}), (env, {"flags": {TOUCH_FLAGS[0]: 1.0}}), (blind, {"flags": told})):
        with pytest.raises(InputError, match="tells no force of contacts"):
            _measuring(place, info)


def tuple_of(*given: Any) -> tuple[Any, ...]:
    return given


BLOCK = """<mujoco><option gravity="0 0 0"/><worldbody><geom name="floor" type="plane" size="1 1 .1" margin=".3"/>
<body name="block" pos="0 0 1"><joint name="z" type="slide" axis="0 0 1" range="-1 1"/><geom type="sphere" size=".5"/>
</body></worldbody><actuator><motor joint="z"/></actuator></mujoco>"""


def test_what_touches_without_pressing_is_in_no_contact(tmp_path: Path) -> None:
    (tmp_path / "block.xml").write_text(BLOCK)
    plant = MuJoCoPlant.of(str(tmp_path / "block.xml"), 1e-3)
    assert [sum(contacts_at(plant, np.array([[z]])).values()) for z in (-0.4, -0.5, -0.6)] == [0, 0, 1]


def test_a_push_begins_at_once_and_has_ended_at_its_end() -> None:
    push = HandPush([0.0, 20.0, 0.0], start=8.0, duration=5.0)  # type: ignore[arg-type]
    assert [push.at(time)[1] for time in (7.999, 8.0, 12.999, 13.0)] == [0.0, 20.0, 20.0, 0.0]
    slow = HandPush([0.0, 20.0, 0.0], start=0.0, duration=5.0, rise=2.5)  # type: ignore[arg-type]
    assert [slow.at(time)[1] for time in (0.0, 1.25, 2.5, 3.75)] == [0.0, 10.0, 20.0, 10.0]


def turned(damping: float) -> Mechanism:
    """An upright pillar with an inertia of 2 kg m^2 about its axis."""
    ten = from_center_of_mass(2.0, [0.0, 0.0, 0.1], 2.0 * np.eye(3))
    return Mechanism(Description("pillar", (Link("pillar", -1, Joint("turn"), Pose.identity(), Pose.identity(), ten),)))


def test_explicit_steps_are_as_many_as_friction_needs_and_eight_at_most() -> None:
    arm, rubbing = turned(0.0), [Friction(viscous=6.0)]  # decays by 3 a second
    for steps in (1, 3, 8):
        assert integration(arm, rubbing, 0.999 * 2.5 * steps / 3.0) == (steps, RungeKutta4())
    assert integration(arm, rubbing, 1.001 * 2.5 / 3.0).substeps == 2
    assert integration(arm, rubbing, 1.001 * 2.5 * 8.0 / 3.0) == (4, LinearlyImplicitEuler())
    assert integration(arm, rubbing, 2.5 * 20.0 / 3.0 - 1e-3, RungeKutta4()).substeps == 20


def test_springs_have_a_step_for_each_radian_and_two_thousand_at_most() -> None:
    arm = turned(0.0)
    springs = Transmission.of(arm, ElasticJoints(stiffness=50.0, damping=0.0, motor_inertia=0.5))
    omega = np.sqrt(50.0 * (1.0 / 2.0 + 1.0 / 0.5))
    for steps in (3, 2000):
        period = (steps - 0.01) / omega
        assert integration(arm, [], period, transmission=springs).substeps == steps
    with pytest.raises(InputError, match="would need 2001 steps per control period, but the limit is 2000"):
        integration(arm, [], 2000.01 / omega, transmission=springs)


@pytest.mark.parametrize(
    ("far", "speed", "told"),
    [(0.9e-6, 3.0, 0), (1.1e-6, 3.0, 1), (0.0, 3.0 * (1.0 + 1e-6), 0), (0.0, 3.0 * (1.0 + 1.1e-6), 1)],
)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_reference_may_be_off_its_limits_by_round_off(far: float, speed: float, told: int, side: float) -> None:
    joint = Joint("turn", limits=Limits(lower=-2.0, upper=2.0, velocity=3.0))
    p, v = np.array([0.0, side * (2.0 + far)]), np.array([0.0, side * speed])
    assert len(_beyond(joint, p, v)) == told


def test_a_log_takes_half_of_the_memory_at_most() -> None:
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    _validate_memory(memory // 2, 1000)
    with pytest.raises(InputError, match="at most 500 fit into half of that"):
        _validate_memory(memory, 1000)
    with pytest.raises(InputError, match="1000 samples need"):
        _validate_memory(memory // 2 + 1, 1000)
