"""Rotors and friction in the joints: parameters like the others, and friction never found from energies."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain, random_tree

from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.drive import COULOMB_SMOOTHING_SPEED
from adaptctl.errors import InputError, SimplificationWarning
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.scalars import column

DRIVES = [Drive(0.5, 2.0, 3.0), Drive(viscous=1.0), Drive(), Drive(rotor_inertia=0.2, coulomb=4.0)]


def driven(mechanism: Mechanism) -> Mechanism:
    """The same tree with the drives above, in turn."""
    description = mechanism.description
    links = [replace(link, joint=replace(link.joint, drive=DRIVES[i % 4])) for i, link in enumerate(description.links)]
    return Mechanism(replace(description, links=tuple(links)))


def states(links: int, seed: int = 0) -> list[np.ndarray]:
    return list(np.random.default_rng(seed).normal(size=(4, links)))


def test_names_and_values_follow_the_links() -> None:
    mechanism = driven(random_tree(1, 4))
    assert mechanism.parameter_names[40:] == (
        "joint0.rotor_inertia",
        "joint3.rotor_inertia",
        "joint0.viscous",
        "joint1.viscous",
        "joint0.coulomb",
        "joint3.coulomb",
    )
    np.testing.assert_array_equal(mechanism.inertial_parameters[40:], [0.5, 0.2, 2.0, 1.0, 3.0, 4.0])
    assert mechanism.description.num_energy_parameters == 42


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 7))
def test_drives_add_their_own_torques_and_nothing_else(seed: int, links: int) -> None:
    plain = random_tree(seed, links)
    mechanism = driven(plain)
    p, v, _, a = states(links, seed)
    drives = [link.joint.drive for link in mechanism.links]
    rotor, viscous, coulomb = (np.array([d.value(kind) or 0.0 for d in drives]) for kind in list(DriveParameter)[:3])
    expected = (
        plain.inverse_dynamics(p, v, a)
        + rotor * a
        + viscous * v
        + coulomb * v / np.sqrt(v**2 + COULOMB_SMOOTHING_SPEED**2)
    )
    torque = mechanism.inverse_dynamics(p, v, a)
    np.testing.assert_allclose(torque, expected, rtol=1e-12, atol=1e-12)
    D = mechanism.inertial_parameters
    np.testing.assert_allclose(mechanism.torque_regressor(p, v, a) @ D, torque, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(mechanism.mass_matrix(p), plain.mass_matrix(p) + np.diag(rotor), rtol=1e-12, atol=1e-13)
    assert mechanism.energy(p, v) == pytest.approx(float(plain.energy(p, v)) + 0.5 * rotor @ v**2, rel=1e-12)
    np.testing.assert_allclose(mechanism.forward_dynamics(p, v, torque), a, rtol=1e-7, atol=1e-7)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 7), st.data())
def test_columns_and_the_tick_know_the_drives(seed: int, links: int, data: st.DataObject) -> None:
    mechanism = driven(random_tree(seed, links))
    total = len(mechanism.parameter_names)
    columns = sorted(data.draw(st.sets(st.integers(0, total - 1), min_size=3)))
    p, v, v_r, a_r = states(links, seed)
    s = np.random.default_rng(seed).normal(size=links)
    Y = mechanism.slotine_li_regressor(p, v, v_r, a_r)
    np.testing.assert_array_equal(mechanism.slotine_li_regressor(p, v, v_r, a_r, columns), Y[:, columns])
    D = mechanism.inertial_parameters
    motion = mechanism.equations.motion(*map(column, (p, v, v_r, a_r)))
    np.testing.assert_allclose(
        motion.regressor_transpose_product(column(s), columns).of, Y[:, columns].T @ s, rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(motion.torque(column(D)).of, Y @ D, rtol=1e-9, atol=1e-9)
    again = mechanism.equations.restored_motion(motion.numbers)
    assert len(motion.numbers) == len(mechanism.equations.motion_memory.sources)
    assert (
        again.regressor_transpose_product(column(s), columns).of
        == motion.regressor_transpose_product(column(s), columns).of
    )


def test_other_parameters_reach_the_drives() -> None:
    mechanism = driven(random_tree(2, 4))
    D = mechanism.inertial_parameters + 1.0
    np.testing.assert_array_equal(mechanism.with_parameters(D).inertial_parameters, D)
    assert mechanism.with_parameters(D).description.sha256 != mechanism.description.sha256
    assert mechanism.with_parameters(D).description.geometry_sha256 == mechanism.description.geometry_sha256


def test_friction_is_always_kept_and_rotors_are_found_from_energies() -> None:
    plain = random_tree(7, 4)
    mechanism = driven(plain)
    space = essential_space(mechanism)
    basis = fundamental_basis(space)
    model = ReducedModel(mechanism, basis)
    assert len(space.parameter_names) == mechanism.description.num_energy_parameters
    assert set(mechanism.parameter_names[mechanism.description.num_energy_parameters :]) <= set(model.names)
    p, v, _, a = states(4)
    np.testing.assert_allclose(model.inverse_dynamics(p, v, a), mechanism.inverse_dynamics(p, v, a), rtol=1e-9)
    assert essential_space(plain).rank <= space.rank


def test_drives_can_be_given_and_taken_away() -> None:
    plain = random_tree(5, 4)
    given = plain.with_drives(DRIVES)
    assert [link.joint.drive for link in given.links] == DRIVES
    assert given.with_drives(Drive()).description == plain.description
    with pytest.raises(InputError, match=r"drives: expected one per joint \(4\), got 3"):
        plain.with_drives(DRIVES[:3])


@pytest.mark.parametrize("bad", [{"viscous": -1.0}, {"coulomb": float("nan")}, {"rotor_inertia": -1e-9}])
def test_negative_friction_is_refused(bad: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(bad))}: expected a finite number of at least 0"):
        Drive(**bad)


@pytest.mark.parametrize("kind", list(DriveParameter))
def test_terms_of_drives_are_bounded_as_links_parameters_are(kind: DriveParameter) -> None:
    """Energies and torques of larger ones overflow."""
    mechanism = random_tree(2, 1).with_drives(Drive(**{kind.value: 1e20}))
    for wrong in (1e21, np.inf, np.nan, -1e21):
        with pytest.raises(InputError, match=rf"{kind.value}: expected a finite number|parameters: expected finite"):
            mechanism.with_parameters([*mechanism.inertial_parameters[:-1], wrong])
    with pytest.raises(InputError, match=f"{kind.value}: expected a number, got 'much'"):
        Drive(**{kind.value: "much"})  # type: ignore[arg-type]


BENT = Drive(0.2, 1.0, 2.0, 1.5, 0.7, -0.3)


def curve(s: np.ndarray) -> np.ndarray:
    """The friction of BENT at a shaft's speed, written out."""
    sign = s / np.sqrt(s**2 + COULOMB_SMOOTHING_SPEED**2)
    return (
        s
        + sign * 2.0
        + 1.5 * s / (s**2 + COULOMB_SMOOTHING_SPEED**2) ** 0.25
        + 0.7 * sign / (1.0 + (s / 0.1) ** 2)
        - 0.3
    )


def coupled(tree: Mechanism) -> Mechanism:
    """The same tree, its last drive turning with the joint before it, backwards and half as fast."""
    last = replace(BENT, turns_with=((tree.links[-2].joint.name, -0.5),))
    return tree.with_drives([*(Drive() for _ in tree.links[1:]), last])


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 6))
def test_a_shaft_that_turns_with_two_joints(seed: int, links: int) -> None:
    """By d'Alembert: the drive's torque times the shaft's virtual turn, which is w of the joints' (w its ratios)."""
    tree = random_tree(seed, links)
    mechanism = coupled(tree)
    w = np.zeros(links)
    w[-2:] = -0.5, 1.0
    p, v, v_r, a = states(links, seed)
    torque = mechanism.inverse_dynamics(p, v, a)
    expected = tree.inverse_dynamics(p, v, a) + w * (0.2 * (w @ a) + curve(w @ v))
    np.testing.assert_allclose(torque, expected, rtol=1e-11, atol=1e-11)
    D = mechanism.inertial_parameters
    np.testing.assert_allclose(mechanism.torque_regressor(p, v, a) @ D, torque, rtol=1e-10, atol=1e-10)
    M = mechanism.mass_matrix(p)
    np.testing.assert_allclose(M, tree.mass_matrix(p) + 0.2 * np.outer(w, w), rtol=1e-11, atol=1e-12)
    stored = 0.1 * (w @ v) ** 2 - 0.3 * (w @ p)
    assert mechanism.energy(p, v) == pytest.approx(float(tree.energy(p, v)) + stored, rel=1e-11)
    np.testing.assert_allclose(mechanism.forward_dynamics(p, v, torque), a, rtol=1e-7, atol=1e-7)
    s, columns = v_r, range(len(D))
    motion = mechanism.equations.motion(*map(column, (p, v, v, a)))
    Y = mechanism.torque_regressor(p, v, a)
    np.testing.assert_allclose(motion.regressor_transpose_product(column(s), columns).of, Y.T @ s, rtol=1e-9, atol=1e-9)


def test_a_shaft_that_turns_with_two_joints_of_a_long_chain() -> None:
    """Its rotor belongs to no one body, so that recursions over bodies do not take it."""
    links = 14
    mechanism = coupled(random_chain(3, links))
    p, v, a, _ = states(links, 1)
    torque = mechanism.inverse_dynamics(p, v, a)
    np.testing.assert_allclose(mechanism.forward_dynamics(p, v, torque), a, rtol=1e-6, atol=1e-6)


def test_the_rank_knows_a_shaft_that_turns_with_two_joints() -> None:
    """Its rotor is told from the links' inertias by the products of both joints' velocities."""
    tree = random_tree(4, 4)
    mechanism = coupled(tree)
    assert essential_space(mechanism).rank in (essential_space(tree).rank, essential_space(tree).rank + 1)
    with pytest.raises(InputError, match="drives coupled to several joints; use method='svd'"):
        essential_space(mechanism, method="transfers")
    plain = coupled(tree).with_drives([*(Drive() for _ in tree.links[1:]), BENT])
    assert plain.geometry_sha256 != mechanism.geometry_sha256
    assert plain.description.sha256 != mechanism.description.sha256


def test_shafts_speak_of_other_joints_once() -> None:
    tree = random_tree(2, 3)
    for others in ((("nowhere", 1.0),), ((tree.links[2].joint.name, 1.0),), ((tree.links[0].joint.name, 1.0),) * 2):
        with pytest.raises(InputError, match=r"turns_with: expected other joints, each once, among .*; got"):
            tree.with_drives([Drive(), Drive(), Drive(1.0, turns_with=others)])
    with pytest.raises(InputError, match="expected a finite ratio other than 0"):
        Drive(1.0, turns_with=(("joint0", 0.0),))
    with pytest.raises(InputError, match="does not support drives coupled to several joints"):
        coupled(tree).to_pinocchio()
    with pytest.warns(SimplificationWarning, match="friction other than viscous and Coulomb"):
        tree.with_drives(BENT).to_pinocchio()
    with pytest.raises(InputError, match="does not support drives coupled to several joints"):
        coupled(tree).in_pinocchio(tree.to_pinocchio())
    with pytest.warns(SimplificationWarning, match="friction other than viscous .*: joint0, joint1, joint2"):
        changed = tree.with_drives(BENT).in_pinocchio(tree.to_pinocchio())
    np.testing.assert_array_equal(changed.damping, np.full(3, BENT.viscous))


@pytest.mark.parametrize("joint", [-1, 3, "a", 1.0])
def test_a_shaft_is_of_a_joint_that_there_is(joint: Any) -> None:
    description = random_tree(2, 3).description
    with pytest.raises(InputError, match=f"joint: expected a whole number from 0 to 2, got {joint!r}"):
        description.drive_coupling(joint)
    assert description.drive_coupling(2) == ((2, 1.0),)


def test_coulomb_friction_fades_below_the_speed_that_the_docs_name() -> None:
    """At that speed v / sqrt(v^2 + w^2) is 1/sqrt(2): with w twice as large it would be 0.45."""
    text = (Path(__file__).parent.parent / "docs" / "concepts.md").read_text(encoding="utf-8")
    (figure,) = re.findall(r"Coulomb friction is smoothed below ([0-9.]+) rad/s", text)
    plain = random_tree(4, 1)
    rubbing = plain.with_drives(Drive(coulomb=1.0))
    for factor, share in ((1.0, 1.0 / np.sqrt(2.0)), (-1.0, -1.0 / np.sqrt(2.0)), (1e-3, 1e-3), (100.0, 1.0)):
        p, v, a = np.zeros(1), np.array([factor * float(figure)]), np.zeros(1)
        torque = rubbing.inverse_dynamics(p, v, a) - plain.inverse_dynamics(p, v, a)
        np.testing.assert_allclose(torque, share, rtol=1e-4)
