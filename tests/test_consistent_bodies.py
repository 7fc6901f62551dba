"""Coordinates of consistent bodies, also in MuJoCo specifications, against MuJoCo's inverse dynamics."""

from __future__ import annotations

import sys

import mujoco
import numpy as np
import pytest
from nightly import mostly_at_night
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import least_squares

import adaptctl
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import from_pseudo_inertia, is_physically_consistent, pseudo_inertia
from adaptctl.errors import InputError, MissingExtraError, NotFoundError
from adaptctl.identifiability import ConsistentBodies
from adaptctl.identification import MujocoBodies

ARM = """<mujoco><worldbody><body name="base" pos="0 0 1"><body name="upper" euler="20 0 0"><joint name="a" axis="0 0 1"
armature="0.05"/><inertial pos="0.1 0 0.02" mass="3" fullinertia="0.03 0.04 0.05 0.002 0.001 0"/>
<body name="lower" pos="0.4 0 0"><joint name="b" axis="0 1 0" pos="0.01 0 0"/>
<inertial pos="0.1 0 0" mass="2" diaginertia="0.01 0.02 0.02"/>
<body name="tool" pos="0.3 0 0.1" euler="0 30 40"><inertial pos="0.05 0 0" mass="0.5" diaginertia="0.002 0.001 0.002"/>
</body></body></body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def arm() -> MujocoBodies:
    return MujocoBodies.of(mujoco.MjSpec.from_string(ARM))


@pytest.fixture(scope="module")
def bodies(arm: MujocoBodies) -> ConsistentBodies:
    return arm.bodies


def torques(spec: mujoco.MjSpec) -> NDArray[np.float64]:
    """MuJoCo's torques in some states."""
    model, random = spec.compile(), np.random.default_rng(0)
    data, out = mujoco.MjData(model), []
    for _ in range(30):
        data.qpos[:], data.qvel[:], data.qacc[:] = random.normal(size=(3, 2))
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse.copy())
    return np.concatenate(out)


def written(arm: MujocoBodies, coordinates: NDArray[np.float64]) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(ARM)
    arm.write(spec, coordinates)
    return spec


@pytest.mark.parametrize("size", [0.5, 10.0, 1e3])
def test_all_coordinates_are_consistent_bodies(bodies: ConsistentBodies, size: float) -> None:
    for seed in range(20):
        found = bodies.at(size * np.random.default_rng(seed).normal(size=bodies.size))
        assert all(is_physically_consistent(ten) for ten in found)


def test_coordinates_are_of_ten_thousand_at_most(bodies: ConsistentBodies) -> None:
    far = np.zeros(bodies.size)
    far[-1] = -1e4
    assert bodies.at(far).shape == (len(bodies.roots), 10)
    with pytest.raises(InputError, match="expected at most 10000, got 10001"):
        bodies.at(1.0001 * far)


@pytest.mark.parametrize("seed", mostly_at_night(range(8), 1, 2))
def test_each_consistent_arm_has_one_point_of_its_base_parameters(bodies: ConsistentBodies, seed: int) -> None:
    """Bodies that are several times others, and flat, are reached, from two beginnings at one point."""
    random = np.random.default_rng(seed)
    turns = 0.7 * random.normal(size=(2, 4, 4))
    others = [
        from_pseudo_inertia(root @ expm(turn + turn.T) @ root.T) for root, turn in zip(bodies.roots, turns, strict=True)
    ]
    wanted = bodies.basis.regrouping @ np.concatenate(others)
    found = [
        least_squares(lambda x: bodies.base_parameters(x) - wanted, start, xtol=1e-15, gtol=1e-15)
        for start in (np.zeros(bodies.size), random.normal(size=bodies.size))
    ]
    for one in found:
        np.testing.assert_allclose(bodies.base_parameters(one.x), wanted, atol=1e-9)
    np.testing.assert_allclose(found[0].x, found[1].x, atol=1e-5)


def test_bodies_are_the_nearest_that_have_their_base_parameters(bodies: ConsistentBodies) -> None:
    """E - 1/E of the change E is in the span of the directions; a coordinate is a base parameter and a tenth of it."""
    z = np.random.default_rng(2).normal(size=bodies.size)
    inverse = np.linalg.inv(bodies.roots)
    E = inverse @ np.stack([pseudo_inertia(ten) for ten in bodies.at(z)]) @ inverse.mT
    D = bodies.directions.reshape(bodies.size, -1)
    X = 0.5 * (E - np.linalg.inv(E)).ravel()
    np.testing.assert_allclose(D.T @ (D @ X), X, atol=1e-9)
    np.testing.assert_allclose(D @ (E - np.eye(4)).ravel() + 0.1 * D @ X, z, atol=1e-10)


def test_a_start_of_other_bodies_is_refused() -> None:
    basis = adaptctl.fundamental_basis(adaptctl.essential_space(adaptctl.load("two_link")))
    with pytest.raises(InputError, match=r"start: link 1 of 2 is not physically consistent"):
        ConsistentBodies.of(basis, [[1, 0, 0, 0, 1, 0, 1, 0, 0, 1], [1, 0, 0, 0, 1, 0, 1, 0, 0, 3]])
    with pytest.raises(InputError, match=r"start: expected shape \(2, 10\) for this basis, got \(1, 10\)"):
        ConsistentBodies.of(basis, np.ones(10))
    geared = adaptctl.load("two_link").with_drives(Drive(rotor_inertia=0.1))
    with pytest.raises(InputError, match="basis: expected that of links alone; take rotor inertias off"):
        ConsistentBodies.of(adaptctl.fundamental_basis(adaptctl.essential_space(geared)), np.ones((2, 10)))


def test_the_start_moves_as_the_specification(arm: MujocoBodies) -> None:
    """With what is fixed to a body, which becomes massless."""
    spec = written(arm, np.zeros(arm.bodies.size))
    np.testing.assert_allclose(torques(spec), torques(mujoco.MjSpec.from_string(ARM)), atol=1e-9)
    assert spec.compile().body("tool").mass == 0.0


def test_torques_are_those_of_the_base_parameters(arm: MujocoBodies) -> None:
    """Changes of the torque are linear in those of the base parameters, down to those of finite differences."""
    random, size = np.random.default_rng(1), arm.bodies.size
    points = [np.zeros(size), *random.uniform(-1.0, 1.0, (size + 3, size))]
    base = np.stack([arm.bodies.base_parameters(x) for x in points])
    found = np.stack([torques(written(arm, x)) for x in points])
    slopes = np.linalg.lstsq(base[1:] - base[0], found[1:] - found[0], rcond=None)[0]
    np.testing.assert_allclose((base[1:] - base[0]) @ slopes, found[1:] - found[0], atol=1e-8)
    near = 1e-7 * points[1]
    change = arm.bodies.base_parameters(near) - base[0]
    np.testing.assert_allclose(torques(written(arm, near)) - found[0], change @ slopes, atol=1e-12)


def test_each_coordinate_changes_the_torques(arm: MujocoBodies) -> None:
    start = torques(written(arm, np.zeros(arm.bodies.size)))
    columns = [torques(written(arm, 0.1 * unit)) - start for unit in np.eye(arm.bodies.size)]
    scaled = np.array([column / np.linalg.norm(column) for column in columns])
    assert np.linalg.cond(scaled) < 1000.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="lower"', 'name="lower" gravcomp="1"', "body 'lower' has gravity compensation"),
        ('name="tool"', "", "body 'body4' has no name; name it"),
        ("<mujoco>", '<mujoco><option density="1.2"/>', "drag depends on each body's inertia"),
        ("<mujoco>", '<mujoco><compiler inertiafromgeom="true"/>', "compiler: inertiafromgeom replaces what"),
        ("<mujoco>", '<mujoco><compiler boundmass="1"/>', "compiler: boundmass changes what is written"),
        ('<body name="base" pos="0 0 1">', '<body name="base"><freejoint/><inertial pos="0 0 0" mass="1" '
         'diaginertia="1 1 1"/>', "body 'base' has a floating base"),
    ],
)  # fmt: skip
def test_what_base_parameters_do_not_cover_is_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        MujocoBodies.of(mujoco.MjSpec.from_string(ARM.replace(old, new)))


def test_wrong_arguments_are_named(arm: MujocoBodies, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(NotFoundError, match="spec: there is no body 'upper'"):
        arm.write(mujoco.MjSpec.from_string("<mujoco/>"), np.zeros(arm.bodies.size))
    with pytest.raises(InputError, match="spec: expected a MjSpec, as"):
        MujocoBodies.of("arm.xml")
    with pytest.raises(NotFoundError, match="uper"):
        MujocoBodies.of(mujoco.MjSpec.from_string(ARM), "uper")
    with pytest.raises(InputError, match=r"coordinates: expected shape \(..., \d+\), got \(2,\)"):
        arm.bodies.at(np.zeros(2))
    with pytest.raises(InputError, match="reach: expected"):
        arm.to_sysid(reach=-1.0)
    monkeypatch.setitem(sys.modules, "mujoco.sysid", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'mujoco\[sysid\]'"):
        arm.to_sysid()
