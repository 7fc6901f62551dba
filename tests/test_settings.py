"""Settings that are no numbers, of another shape or out of bounds, are refused in a line that names them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from robot_files import urdf
from sampled_loops import arm, reduced

import adaptctl
from adaptctl.arrays import Array
from adaptctl.control import (
    Composite,
    CompositeLearning,
    ConcurrentLearning,
    DeadZone,
    EModification,
    GainDesign,
    Gradient,
    LinearController,
    Natural,
    PriorRanges,
    Projection,
    ReleasedGradient,
    SigmaModification,
    Spline,
    adaptation_gain,
    limits,
    sampling_ratio,
    worst_conditioned_configuration,
)
from adaptctl.control.adaptation.prior_ranges import estimate_sampling_ratio, parameter_sampling_ratios
from adaptctl.control.excitation.measure import persistent_excitation
from adaptctl.control.gains.error_feedback import ErrorFeedback
from adaptctl.design import DesignTask, MountingBounds
from adaptctl.design.bodies import box, cylinder
from adaptctl.design.simplifications import simplifications
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError, NonFiniteError, NotFoundError
from adaptctl.identifiability import Constraints, ReducedModel
from adaptctl.identifiability.sampling import States
from adaptctl.simulation import Plant
from adaptctl.simulation.effects import ActuatorLag, Encoder

ONES, TEXT = np.ones(15), cast(Any, "a")
UR5 = urdf("ur5_robot.urdf")


def model() -> ReducedModel:
    return reduced("puma560_arm3")


def task() -> DesignTask:
    return DesignTask.within_limits(arm("puma560_arm3"), 50)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Gradient(cast(Any, ["a"])), "adaptation gain: expected numbers"),
        (lambda: Gradient(ONES, theta=TEXT), "Gradient: theta: expected a number, got 'a'"),
        (lambda: Gradient(ONES, cap=cast(Any, [1.0, 2.0])), "Gradient: cap: expected a number"),
        (lambda: SigmaModification(ONES, leakage=TEXT), "SigmaModification: leakage"),
        (lambda: CompositeLearning(ONES, recall=TEXT), "CompositeLearning: recall"),
        (lambda: Natural(TEXT), "natural adaptation: gain: expected numbers"),
        (lambda: Projection(Gradient(ONES), cast(Any, ["a"] * 15), ONES), "projection: lower: expected numbers"),
        (lambda: PriorRanges(mass=TEXT), "prior range of mass"),
        (lambda: Composite(ONES, cutoff=-1.0), "cutoff: expected a positive number in rad/s"),
        (lambda: ConcurrentLearning(ONES, cutoff=np.nan), "cutoff: expected a positive number in rad/s"),
        (lambda: CompositeLearning(ONES, cutoff=0.0), "cutoff: expected a positive number in rad/s"),
        (lambda: DeadZone.for_disturbance(ONES, 5.0, -1.0), "dead zone: torque: expected numbers of at least 0"),
        (lambda: DeadZone.for_disturbance(ONES, 5.0, TEXT), "dead zone: torque: expected numbers"),
        (lambda: adaptation_gain(model(), gain_scale=-1.0), "gain_scale: expected a positive number"),
        (lambda: adaptation_gain(model(), gain_scale=np.nan), "gain_scale: expected a positive number"),
        (lambda: sampling_ratio(arm("puma560_arm3"), 5.0, 1e-3, 8.0, estimate=[1.0]), "expected shape"),
        (lambda: sampling_ratio(arm("puma560_arm3"), 5.0, 1e-3, 8.0, estimate=np.full(30, np.nan)), "finite"),
        (lambda: worst_conditioned_configuration(arm("puma560_arm3"), [1.0]), "expected shape"),
        (lambda: parameter_sampling_ratios(model(), [8.0, 8.0], 1e-3), "bandwidth: expected a number or 3"),
        (lambda: parameter_sampling_ratios(model(), 8.0, -1e-3), "period: expected a positive time"),
        (lambda: estimate_sampling_ratio(model(), ONES, [1.0], 8.0, 1e-3), "prior: expected shape"),
        (lambda: estimate_sampling_ratio(model(), [1.0], ONES, 8.0, 1e-3), "gain: expected shape"),
        (lambda: estimate_sampling_ratio(model(), np.zeros(15), ONES, 8.0, 1e-3), "gain: expected a positive diagonal"),
        (
            lambda: estimate_sampling_ratio(model(), np.zeros((15, 15)), ONES, 8.0, 1e-3),
            "symmetric positive definite matrix",
        ),
        (
            lambda: estimate_sampling_ratio(model(), np.triu(np.ones((15, 15))), ONES, 8.0, 1e-3),
            "symmetric positive definite",
        ),
        (lambda: estimate_sampling_ratio(model(), ONES, -ONES, 8.0, 1e-3), "prior: expected numbers of at least 0"),
        (
            lambda: estimate_sampling_ratio(model(), ONES, ONES, 8.0, 1e-3, kinetic=-1.0),
            "kinetic: expected a finite number of at least 0",
        ),
        (lambda: parameter_sampling_ratios(model(), -8.0, 1e-3), "bandwidth: expected finite numbers of at least 0"),
        (
            lambda: parameter_sampling_ratios(model(), [8.0, np.inf, 8.0], 1e-3),
            "bandwidth: expected finite numbers of at least 0",
        ),
        (
            lambda: GainDesign.from_bandwidth(arm("puma560_arm3"), 8.0, delay=cast(Any, np.nan)),
            "delay: expected a whole",
        ),
        (lambda: GainDesign.from_bandwidth(arm("puma560_arm3"), 8.0, delay=cast(Any, 2.0)), "delay: expected a whole"),
        (lambda: GainDesign.from_bandwidth(arm("puma560_arm3"), 8.0, delay=TEXT), "delay: expected a whole number"),
        (lambda: GainDesign.from_bandwidth(arm("puma560_arm3"), 8.0, delay=1001), "delay: expected a whole number"),
        (lambda: ReleasedGradient.certified(model(), np.ones(16), 5.0, 1e-3), "adaptation gain: expected 15 numbers"),
        (lambda: ErrorFeedback(100.0, 20.0, 1e-3).loop(-1), "delay in periods: expected a whole number from 0"),
        (lambda: ErrorFeedback(100.0, 20.0, 1e-3).loop(cast(Any, 0.5)), "delay in periods"),
        (lambda: simplifications(task(), [], density=0.0), "density: expected a positive number"),
        (lambda: MountingBounds.for_link(arm("puma560_arm3"), "link3").grid(0), "grid: points_per_edge"),
        (lambda: MountingBounds.for_link(arm("puma560_arm3"), "link3").grid(101), "grid: points_per_edge"),
        (lambda: DesignTask.within_limits(arm("puma560_arm3"), cast(Any, 5.5)), "samples: expected a whole number"),
        (lambda: DesignTask.within_limits(arm("puma560_arm3"), 50, seed=-1), "seed: expected a whole number"),
        (lambda: DesignTask(arm("puma560_arm3"), *np.ones((3, 2, 30, 3)), ""), r"expected one shape \(samples, 3\)"),
        (lambda: task().nonzero_parameters(share=np.nan), "share: expected a number, got nan"),
        (lambda: box(TEXT, (1.0, 1.0, 1.0)), "mass: expected"),
        (lambda: cylinder(TEXT, 1.0, 1.0), "mass: expected"),
    ],
)
def test_settings_that_cannot_be_are_refused(make: Callable[[], object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()


@pytest.mark.parametrize("off", [(np.nan, 1.0), (1.0, np.nan)])
def test_bounds_that_are_no_numbers_are_refused(off: tuple[float, float]) -> None:
    with pytest.raises(NonFiniteError, match=r"bounds: link1.I_yy: expected numbers, got \["):
        limits(model(), {"link1.I_yy": off})


@pytest.mark.parametrize("off", [(1.0, -1.0), (1.0, 1.0), (1.0,), 1.0, (1.0, 2.0, 3.0), ("a", "b")])
def test_bounds_that_leave_nothing_or_are_no_pair_are_refused(off: Any) -> None:
    with pytest.raises(InputError, match=r"bounds: link1.I_yy: expected .*, got"):
        limits(model(), {"link1.I_yy": off})


def test_a_prior_range_is_that_of_a_known_kind_of_parameter() -> None:
    arm_with_drives = arm("puma560_geared")
    assert np.all(PriorRanges().for_parameters(arm_with_drives.parameter_names) > 0.0)
    with pytest.raises(NotFoundError, match=r"'link1.I_yyy': expected one .* \(did you mean 'I_yy'\?\)"):
        PriorRanges().for_parameters(("link1.m", "link1.I_yyy"))


@pytest.mark.parametrize(
    ("estimate", "true", "says"),
    [
        (np.ones(16), ONES, r"estimate: expected shape \(..., 15\), got \(16,\)"),
        (ONES, np.ones(16), r"true: expected shape \(..., 15\), got \(16,\)"),
        (1.0, ONES, r"estimate: expected shape \(..., 15\), got \(\)"),
        (np.ones((5, 15)), np.ones((4, 15)), r"sample axes do not fit together: estimate \(5, 15\), true \(4, 15\)"),
        (TEXT, ONES, "estimate: expected numbers"),
    ],
)
def test_the_distance_of_what_are_not_the_parameters_is_refused(estimate: Any, true: Any, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Gradient(ONES).lyapunov_distance(model(), estimate, true)


def test_one_torque_serves_all_joints_of_a_dead_zone() -> None:
    one, each = (DeadZone.for_disturbance(ONES, [5.0, 6.0, 7.0], torque) for torque in (0.5, [0.5] * 3))
    np.testing.assert_array_equal(one.width, each.width)


def test_a_spline_at_no_time_is_not_at_rest() -> None:
    reference = Spline(np.linspace(0.0, 1.0, 8)[:, None] ** 3, np.arange(8.0))
    assert all(np.isnan(part).all() for part in reference(np.array([np.nan])))
    assert all(np.isfinite(part).all() for part in reference(np.array([-1.0, 3.0, 9.0])))


def test_excitation_is_measured_at_a_bandwidth_of_the_joints() -> None:
    class Run:
        p = v = reference_p = reference_v = reference_a = np.zeros((100, 3))
        sample_time = 1e-3

    with pytest.raises(InputError, match="bandwidth: expected a number or 3"):
        persistent_excitation(model(), cast(Any, Run()), 0.05, bandwidth=[1.0, 2.0])


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: noisy().init(np.zeros((2, 3)), np.zeros((3, 3))), "sample axes do not fit"),
        (lambda: noisy().init(np.zeros(3), np.zeros(3), noise=np.zeros(5)), r"noise: expected shape \(..., 6\)"),
        (lambda: noisy().init(np.zeros(3), np.zeros(3), noise=np.zeros((2, 6))), "noise: expected values for"),
        (lambda: noisy().init(np.zeros(3), np.zeros(3), noise=np.full(6, np.nan)), "noise: expected finite"),
        (lambda: lagging().init(np.zeros(3), np.zeros(3), np.ones(4)), "parameters: expected shape"),
        (lambda: lagging().init(np.zeros(3), np.zeros(3), np.full(30, np.nan)), "parameters: expected finite"),
        (lambda: energy_at(np.full(30, np.nan)), "parameters: expected finite"),
        (
            lambda: Plant(arm("puma560_arm3"), 1e-3, effects=cast(Any, ActuatorLag(1e-3))),
            "effects: expected a sequence",
        ),
        (lambda: LinearController(*(cast(Any, 1.0),) * 4), r"A: expected shape \(0, 0\)"),
        (lambda: LinearController.state_feedback(TEXT), "state feedback: gain: expected numbers"),
        (lambda: Constraints.from_matrix(TEXT, ["link1.m"]), "relations: matrix: expected numbers"),
        (lambda: States(np.full((5, 3), np.nan), np.zeros((5, 3)), "measured"), "states: p: expected finite"),
        (
            lambda: arm("puma560_arm3").column_regressor("regressor", [0]),
            "expected torque_regressor or slotine_li_regressor",
        ),
        (lambda: five_bar().configuration(np.zeros((2, 3)), five_bar_start(3)), "sample axes do not fit"),
        (lambda: five_bar().configuration(np.zeros(3), five_bar_start(3)), "start: expected one configuration"),
        (
            lambda: adaptctl.load(arm("puma560_arm3").to_pinocchio(), floating_base=True),
            "floating_base and mesh_folders: only for files",
        ),
    ],
)
def test_arguments_that_cannot_be_are_refused(make: Callable[[], object], says: str) -> None:
    with pytest.raises((InputError, NonFiniteError), match=says):
        make()


def noisy() -> Plant:
    return Plant(arm("puma560_arm3"), 1e-3, effects=(Encoder(1e-3),))


def lagging() -> Plant:
    return Plant(arm("puma560_arm3"), 1e-3, effects=(ActuatorLag(1e-3),))


def energy_at(parameters: Array) -> float:
    plant = Plant(arm("puma560_arm3"), 1e-3)
    return plant.energy(plant.init(np.zeros(3), np.zeros(3)), parameters)


def five_bar() -> Mechanism:
    return arm("semi_direct_drive")


def five_bar_start(samples: int) -> Array:
    reference = five_bar().configuration(np.zeros(3))
    return np.broadcast_to(reference, (samples, len(reference)))


def test_an_inertia_without_mass_is_not_written_into_a_urdf_file(tmp_path: Path) -> None:
    robot = adaptctl.load(UR5)
    parameters = np.array(robot.inertial_parameters)
    parameters[20] = 0.0
    with pytest.raises(FileError, match="URDF does not support inertia without mass"):
        robot.with_parameters(parameters).write_into(UR5, tmp_path / "out.urdf")
    assert not (tmp_path / "out.urdf").exists()
    parameters[20:30] = 0.0
    robot.with_parameters(parameters).write_into(UR5, tmp_path / "out.urdf")
    np.testing.assert_allclose(adaptctl.load(tmp_path / "out.urdf").inertial_parameters, parameters, atol=1e-12)


@pytest.mark.parametrize("law", [SigmaModification, EModification, ConcurrentLearning])
@pytest.mark.parametrize(
    "gain", [[1.0, -1.0], [1.0, 0.0], [[1.0, 2.0], [2.0, 1.0]]], ids=["negative", "zero", "matrix"]
)
def test_laws_with_numbers_of_their_own_refuse_a_gain_as_the_gradient_does(law: Any, gain: Any) -> None:
    with pytest.raises(InputError, match=r"^adaptation gain: expected a positive"):
        law(np.array(gain))
