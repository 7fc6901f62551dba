"""Springs and harmonics of the angle: parameters of a joint that depend on its position."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from random_trees import random_tree

import adaptctl
from adaptctl.arrays import Array
from adaptctl.description.drive import Drive
from adaptctl.description.writers.mechanism_file import write_mechanism
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import column
from adaptctl.simulation.integrator import friction_rate

SPRUNG = Drive(offset=-0.6, stiffness=2.0, sine=1.5, cosine=-0.7, sine_2=0.4, cosine_2=0.9)
NAMES = ("offset", "stiffness", "sine", "cosine", "sine_2", "cosine_2")


def written_out(q: Array) -> Array:
    """The torque of SPRUNG at positions."""
    return -0.6 + 2.0 * q + 1.5 * np.sin(q) - 0.7 * np.cos(q) + 0.4 * np.sin(2.0 * q) + 0.9 * np.cos(2.0 * q)


@pytest.mark.parametrize("links", [2, 13])
def test_springs_add_their_torque_to_every_equation(links: int) -> None:
    tree = random_tree(4, links)
    turns = [link.joint.kind.is_revolute for link in tree.links]
    mechanism = tree.with_drives([SPRUNG if turn else Drive(offset=1.0, stiffness=3.0) for turn in turns])
    p, v, a, s = np.random.default_rng(links).normal(size=(4, links))
    springs = np.where(turns, written_out(p), 1.0 + 3.0 * p)
    torque = tree.inverse_dynamics(p, v, a) + springs
    D = mechanism.inertial_parameters
    np.testing.assert_allclose(mechanism.inverse_dynamics(p, v, a), torque, rtol=1e-12, atol=1e-11)
    np.testing.assert_allclose(mechanism.torque_regressor(p, v, a) @ D, torque, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(mechanism.forward_dynamics(p, v, torque), a, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(mechanism.mass_matrix(p), tree.mass_matrix(p), rtol=1e-12)
    motion = mechanism.equations.motion(*map(column, (p, v, v, a)))
    again = mechanism.equations.restored_motion(motion.numbers)
    Y, columns = mechanism.torque_regressor(p, v, a), range(len(D))
    for one in (motion, again):
        powers = one.regressor_transpose_product(column(s), columns).of
        np.testing.assert_allclose(powers, Y.T @ s, rtol=1e-9, atol=1e-8)


def test_energy_has_what_springs_store() -> None:
    """Its slope along a motion is the power of their torques, by a central difference."""
    tree = random_tree(4, 3)
    turning = tree.with_drives([SPRUNG if link.joint.kind.is_revolute else Drive() for link in tree.links])
    p, direction = np.random.default_rng(3).normal(size=(2, 3))
    still, h = np.zeros(3), 1e-5
    ahead, behind = (float(turning.energy(p + x * direction, still)) for x in (h, -h))
    force = turning.inverse_dynamics(p, still, still)
    assert (ahead - behind) / (2.0 * h) == pytest.approx(direction @ force, rel=1e-8)


def test_mujoco_has_the_same_springs_and_gives_them_back() -> None:
    arm = adaptctl.load("puma560_measured")
    springs = [Drive(stiffness=3.0 + k, offset=0.5 * k or None) for k in range(6)]
    sprung = arm.with_drives(springs)
    model = sprung.to_mujoco()
    data = mujoco.MjData(model)
    for p, v, a in 0.3 * np.random.default_rng(0).normal(size=(5, 3, 6)):
        data.qpos[:], data.qvel[:], data.qacc[:] = p, v, a
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(sprung.inverse_dynamics(p, v, a), data.qfrc_inverse, rtol=1e-9, atol=1e-9)
    back = Mechanism.from_mujoco(model)
    assert [link.joint.drive.stiffness for link in back.links] == [drive.stiffness for drive in springs]
    offsets = [link.joint.drive.offset or 0.0 for link in back.links]
    np.testing.assert_allclose(offsets, [0.5 * k for k in range(6)])


def test_springs_are_kept_in_files_and_as_parameters(tmp_path: Path) -> None:
    arm = adaptctl.load("two_link").with_drives([Drive(), SPRUNG])
    write_mechanism(tmp_path / "sprung.toml", arm.description)
    again = adaptctl.load(tmp_path / "sprung.toml")
    assert again.links[1].joint.drive == SPRUNG
    assert again.parameter_names[-6:] == tuple(f"{arm.links[1].joint.name}.{name}" for name in NAMES)
    assert set(again.parameter_names[-6:]) <= set(adaptctl.ReducedModel(again).names)


def test_a_spring_acts_on_its_joint_alone_whatever_turns_the_shaft() -> None:
    tree = random_tree(4, 3)
    shared = Drive(stiffness=2.0, turns_with=((tree.links[0].joint.name, -1.5),))
    p = np.array([0.3, -0.4, 0.5])
    still = np.zeros(3)
    more = tree.with_drives([Drive(), Drive(), shared]).inverse_dynamics(p, still, still)
    np.testing.assert_allclose(more - tree.inverse_dynamics(p, still, still), [0.0, 0.0, 1.0], atol=1e-12)


def test_torques_at_rest_are_no_friction_to_the_integrator() -> None:
    """An offset was taken for 5e9 1/s of it, so that plants with one were integrated with the most steps."""
    arm = adaptctl.load("two_link")
    rubbing = friction_rate(arm.with_drives(Drive(viscous=1.0)))
    assert friction_rate(arm.with_drives(Drive(viscous=1.0, offset=3.0, stiffness=40.0))) == pytest.approx(rubbing)


def test_harmonics_of_an_angle_need_one() -> None:
    tree = random_tree(4, 6)
    assert not all(link.joint.kind.is_revolute for link in tree.links)
    with pytest.raises(InputError, match="cosine: harmonics of the angle are of joints that turn; remove it"):
        tree.with_drives(Drive(cosine=1.0))
