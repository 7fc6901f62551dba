"""Plant, reference and gains of a disturbed arm, by numbers that are written out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import adaptctl
from adaptctl.control import typical_inertia
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NotFoundError
from adaptctl.experiments.laws import Laws
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.simulation import effects


@pytest.fixture(scope="module")
def arm() -> Mechanism:
    return adaptctl.load("puma560_geared")


def only(given: Laws, arm: Mechanism, stiffness: float = 0.0) -> Any:
    (found,) = given.effects(arm, stiffness)
    return found


def test_five_sinusoids_a_joint_are_a_quarter_off_their_frequencies_at_most(arm: Mechanism) -> None:
    one, other = (Laws(seed=seed, amplitude=0.3).reference(arm) for seed in (0, 1))
    np.testing.assert_array_equal(one.center, [0.0, -0.6, 0.8, 0.0, 0.5, 0.0])
    shares = np.stack([each.frequency for each in (one, other)]) / np.array([0.15, 0.3, 0.55, 0.85, 1.2])[:, None]
    assert 0.8 <= shares.min() < 0.85
    assert 1.2 < shares.max() <= 1.25
    np.testing.assert_allclose(one.amplitude, 0.3 * np.sqrt(0.2 / one.frequency))
    phases = np.array([one.phase, other.phase], dtype=float)
    assert -np.pi <= phases.min() < -2.0
    assert 2.0 < phases.max() <= np.pi
    assert not np.any(Laws(motion="rest").reference(arm).amplitude)


def test_single_sinusoids_are_those_of_the_experiment_without_disturbances(arm: Mechanism) -> None:
    single, plain = Laws(motion="single").reference(arm), Puma560Adaptive()
    for name in ("center", "amplitude", "frequency"):
        np.testing.assert_array_equal(np.ravel(getattr(single, name)), getattr(plain, name))
    few = adaptctl.load("puma560_geared").locked(["joint4", "joint5", "joint6"])
    assert Laws().reference(few).center.tolist() == [0.0, -0.6, 0.8]
    with pytest.raises(InputError, match="has 3 joints, but this experiment needs 6"):
        Laws(motion="single").reference(few)


def test_a_motion_halts_where_it_is_told(arm: Mechanism) -> None:
    stopped, free = (Laws(reference_stop=stop).followed(arm) for stop in (2.0, 0.0))
    assert not np.any(stopped(np.array([3.5, 5.0])).v)
    np.testing.assert_array_equal(stopped(np.array([1.9])).p, free(np.array([1.9])).p)
    assert np.abs(free(np.array([5.0])).v).max() > 0.0


def test_a_payload_is_a_cube_before_the_flange_in_each_part_of_the_run(arm: Mechanism) -> None:
    given = Laws(
        payload=3.0, payload_size=0.2, payload_offset=0.07, payload_start=4.0, payload_stop=9.0, payload_cycles=2
    )
    held: list[Any] = list(given.effects(arm, 0.0))
    assert [(one.start, one.stop) for one in held] == [(4.0, 9.0), (14.0, 19.0)]
    assert held[0].payload.mass == 3.0
    body = given.body(0.5)
    assert body.mass == 1.5
    np.testing.assert_array_equal(body.center, [0.0, 0.0, 0.07])
    np.testing.assert_allclose(body.inertia, 1.5 * (0.2**2 + 0.2**2) / 12.0 * np.eye(3))


@pytest.mark.parametrize(
    ("times", "fits"),
    [((2.0, 10.0), True), ((1.9, 10.0), False), ((5.0, 20.0), True), ((5.0, 20.1), False), ((5.0, 5.0), False)],
)
def test_a_payload_is_held_within_the_run_and_not_at_its_begin(times: tuple[float, float], fits: bool) -> None:
    given: dict[str, Any] = {"payload": 1.0, "payload_start": times[0], "payload_stop": times[1]}
    if fits:
        assert Laws(**given).recovers
    else:
        with pytest.raises(InputError, match="expected a pickup at 2 s or later"):
            Laws(**given)
    assert not Laws(payload=1.0, payload_start=0.0, payload_stop=1.0, torque_limit_scale=0.9).recovers


def test_springs_are_damped_by_a_twentieth_of_the_critical(arm: Mechanism) -> None:
    springs: Any = only(Laws(joint_stiffness=(2e4,), encoder_side="motor"), arm, 2e4)
    rotors = np.array([joint.drive.rotor_inertia for joint in arm.primary_joints])
    inertia = typical_inertia(arm)
    links = np.maximum(inertia - rotors, inertia / 1000.0)  # the last one's is less than its rotor's
    critical = 2.0 * np.sqrt(2e4 * links * rotors / inertia)
    np.testing.assert_allclose(springs.damping, 0.05 * critical)
    assert (springs.stiffness, springs.encoders) == (2e4, "motor")


def test_friction_rises_by_its_share_of_coulomb_at_rest(arm: Mechanism) -> None:
    found = only(Laws(stribeck=0.5), adaptctl.load("puma560_friction"))
    drives = [joint.drive for joint in adaptctl.load("puma560_friction").primary_joints]
    np.testing.assert_allclose(found.stribeck, [0.5 * float(drive.coulomb or 0.0) for drive in drives])
    assert found.stribeck_speed == 0.1
    oiled = replace(drives[0], coulomb=None)
    some = adaptctl.load("puma560_friction").with_drives([oiled, *drives[1:]])
    assert only(Laws(stribeck=0.5), some).stribeck[0] == 0.0
    with pytest.raises(InputError, match="no joint friction"):
        only(Laws(stribeck=0.5), adaptctl.load("puma560_measured"))


@pytest.mark.parametrize(
    ("given", "kind"),
    [
        ({"torque_rate_limit": 5.0}, effects.TorqueRateLimit),
        *(({name: 1e-3}, effects.Encoder) for name in ("encoder_resolution", "position_noise", "velocity_noise")),
        ({"velocity_cutoff": 20.0}, effects.FilteredDifferences),
        ({"delay": 3}, effects.ControlDelay),
        ({"drive_time_constant": 0.01}, effects.ActuatorLag),
    ],
)
def test_each_disturbance_is_its_effect(given: dict[str, Any], kind: type, arm: Mechanism) -> None:
    assert type(only(Laws(**given), arm)) is kind


def test_gains_are_twice_what_the_bandwidth_asks_and_motors_are_scaled(arm: Mechanism) -> None:
    given = Laws(bandwidth=6.0, torque_limit_scale=0.25)
    np.testing.assert_allclose(given.gains(arm).damping, 2.0 * 6.0 * typical_inertia(arm))
    np.testing.assert_allclose(given.motors(arm), 0.25 * arm.effort_limits)
    assert [Laws(**weak).is_weak for weak in ({}, {"torque_limit_scale": 0.99}, {"torque_rate_limit": 0.5})] == [
        0,
        1,
        1,
    ]
    assert (Laws().error_bound, Laws(disturbance="payload").error_bound > 1.0) == (1.0, True)


@pytest.mark.parametrize(
    ("given", "error", "told"),
    [
        ({"disturbance": "storm"}, NotFoundError, "disturbance: expected one of none"),
        ({"laws": ("gradient", "own.py:Own")}, NotFoundError, "a law of a file"),
        ({"laws": ("gradient,natural",)}, NotFoundError, "several are separated by blanks"),
        ({"joint_stiffness": (0.0, 1e4)}, InputError, "or only 0 for rigid joints"),
    ],
)
def test_what_cannot_be_is_refused(given: dict[str, Any], error: type[Exception], told: str) -> None:
    with pytest.raises(error, match=told):
        Laws(**given)
