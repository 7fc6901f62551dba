"""References that motors can follow: postures that gravity hardly loads, joints held still only for their own sake."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nightly import nightly

from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.tuning import tune
from adaptctl.tuning.default_gains import DefaultGains
from adaptctl.tuning.feasible_gains import recoverable_error
from adaptctl.tuning.feasible_reference import FeasibleReference, feasible_reference
from tests.random_trees import random_tree
from tests.robot_files import urdf

PUMA = load("puma560_measured")
ROUND = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
LIFT = """<robot name="lift">
  <link name="ground"/>
  <link name="tower"><inertial><mass value="2"/>{inertia}</inertial></link>
  <link name="boom"><inertial><mass value="1"/>{inertia}</inertial></link>
  <joint name="lift" type="prismatic"><parent link="ground"/><child link="tower"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="{effort}" velocity="1"/></joint>
  <joint name="pan" type="revolute"><parent link="tower"/><child link="boom"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="50" velocity="2"/></joint>
</robot>"""


def reference(mechanism: Mechanism) -> FeasibleReference:
    return feasible_reference(mechanism, finite_torque_limits(mechanism), 0)


def lift(folder: Path, effort: float) -> Mechanism:
    path = folder / "lift.urdf"
    path.write_text(LIFT.format(effort=effort, inertia=ROUND), encoding="utf-8")
    return load(path)


def weakened(mechanism: Mechanism, joint: int, effort: float) -> Mechanism:
    """The mechanism with another torque limit of one joint."""
    links = list(mechanism.description.links)
    limits = replace(links[joint].joint.limits, effort=effort)
    links[joint] = replace(links[joint], joint=replace(links[joint].joint, limits=limits))
    return Mechanism(replace(mechanism.description, links=tuple(links)))


@pytest.mark.filterwarnings("ignore:.*the base is held still:adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize("name", ["baxter.urdf", "pr2.urdf"])
def test_a_gripper_whose_fingers_move_together_hides_no_posture(name: str) -> None:
    """Mimicking fingers close no loop: the arms are put where gravity asks little, far from the position of zero."""
    found = reference(load(urdf(name)))
    assert found.static.max() < 0.5
    assert found.reduced.min() > 0.3
    assert found.asked.max() <= 0.75 + 1e-9


def test_gains_of_an_arm_with_such_a_gripper_are_judged_off_its_reference() -> None:
    """Judged on the reference alone, the Panda was given gains that rang when links were off and torques late."""
    panda = load(urdf("panda.urdf"))
    rule = DefaultGains.for_mechanism(panda, reference=reference(panda).reference, initial_error=0.1)
    np.testing.assert_allclose(np.abs(rule.errors), 0.1)
    away = np.abs(rule.postures - rule.reference_points.p).max(axis=0)
    assert np.all(away[:7] > 0.1)
    assert away[7] > 0.01


def test_gains_of_a_closed_loop_are_judged_where_it_can_be() -> None:
    arm = load("semi_direct_drive_parallelogram")
    rule = DefaultGains.for_mechanism(arm, reference=reference(arm).reference, initial_error=0.1)
    assert arm.continuation is not None
    for p in (rule.postures, rule.reference_points.p + rule.errors):
        assert arm.continuation.reachable(p).all()


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PlausibilityWarning")  # gravity is beyond the limit, on purpose
def test_a_joint_that_gravity_holds_is_held_still_and_no_other(tmp_path: Path) -> None:
    found = reference(lift(tmp_path, 20.0))
    assert found.static[0] == pytest.approx(3.0 * 9.81 / 20.0, rel=0.01)
    np.testing.assert_array_equal(found.reduced, [0.0, 1.0])
    points = found.reference(np.linspace(0.0, 20.0, 101))
    assert np.ptp(points.p[:, 0]) == 0.0
    assert np.ptp(points.p[:, 1]) > 0.1


def test_a_joint_that_can_move_is_moved(tmp_path: Path) -> None:
    found = reference(lift(tmp_path, 60.0))
    assert np.all(found.reduced > 0.3)
    assert found.asked[0] <= 0.75 + 1e-9


def test_friction_as_high_as_the_limit_leaves_room() -> None:
    """Coulomb friction of all the torque there is: such a joint creeps, below its limit."""
    drives = [Drive() for _ in range(5)] + [Drive(coulomb=2.0)]
    weak = weakened(PUMA.with_drives(drives), 5, 2.0)
    found = reference(weak)
    assert found.static[5] > 0.99
    assert found.asked.max() <= 0.95
    assert found.reduced[5] > 0.0


@pytest.mark.parametrize("seed", range(6))
def test_no_joint_of_a_tree_asks_for_more_than_its_share(seed: int) -> None:
    tree = random_tree(seed, 4)
    limits = finite_torque_limits(tree) / 4.0
    found = feasible_reference(tree, limits, seed)
    held = found.reduced == 0.0
    allowed = np.clip(0.5 * (1.0 + found.static), 0.6, 0.95)
    assert np.all(found.asked[~held] <= allowed[~held] + 1e-9)
    points = found.reference(np.linspace(0.0, 20.0, 501))
    asked = np.abs(tree.inverse_dynamics(points.p, points.v, points.a)).max(axis=0) / limits
    np.testing.assert_allclose(asked, found.asked, rtol=0.02)


def test_the_centre_is_the_same_in_python_and_in_native_code() -> None:
    """Equations are compiled once they are called often, and differ then by round-off."""
    arm = PUMA.with_parameters(1.01 * PUMA.inertial_parameters)
    first, rest = reference(arm), np.zeros(6)
    for _ in range(60):
        arm.inverse_dynamics(rest, rest, rest)
    np.testing.assert_array_equal(reference(arm).reference(0.0).p, first.reference(0.0).p)


@nightly
def test_a_weak_joint_starts_near_enough_to_be_brought_back() -> None:
    """An initial error of 0.1 rad, with a torque of 0.3 N m on 4 kg m^2, would take a bandwidth below 1 1/s."""
    tuning = tune(weakened(PUMA, 0, 0.3))
    assert tuning.initial_error[0] < 0.08
    np.testing.assert_array_equal(tuning.initial_error[1:], tune(PUMA).initial_error[1:])
    inertia = PUMA.mass_matrix(tuning.reference(0.0).p)[0, 0]
    assert tuning.initial_error[0] == pytest.approx(0.3 * 0.3 / inertia, rel=1e-9)
    given = tune(weakened(PUMA, 0, 0.3), initial_error=0.1)
    np.testing.assert_array_equal(given.initial_error, np.full(6, 0.1))


@pytest.mark.filterwarnings("ignore:.*the base is held still:adaptctl.errors.SimplificationWarning")
def test_gravity_at_the_initial_error_leaves_torque_for_heavier_links() -> None:
    """The humanoid balances on a waist with a weak motor: 0.1 rad off in every joint, links 30 % off, it fell."""
    humanoid = load(urdf("simple_humanoid.urdf"))
    limits, wanted = finite_torque_limits(humanoid), reference(humanoid).reference
    start, rest = wanted(0.0).p, np.zeros(humanoid.dof)
    error = recoverable_error(humanoid, limits, wanted)
    assert np.abs(humanoid.inverse_dynamics(start + error, rest, rest) / limits).max() <= 0.4
    assert np.abs(humanoid.inverse_dynamics(start + 1.3 * error, rest, rest) / limits).max() > 0.4
    assert error.min() > 0.02
