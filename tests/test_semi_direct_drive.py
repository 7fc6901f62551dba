"""The semi-direct-drive arm against section 5.2 of Sheu and Walker (1991), and what its file says of itself."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from five_bars import NARROW, WIDE, closes_everywhere, five_bar, spread
from nightly import mostly_at_night

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.dynamics import load
from adaptctl.errors import SingularityError
from adaptctl.identifiability import EssentialSpace, Priority, essential_space, fundamental_basis, states_within_limits

# Table 11: the order in which parameters are to be removed, by kind (rows) and link.
TABLE_11 = ("m", "mc_x", "mc_y", "mc_z", "I_xy", "I_xz", "I_yz", "I_xx", "I_yy", "I_zz")
# Table 12: the links whose parameter of each kind is kept.
TABLE_12 = {
    "mc_x": (3, 4, 5),
    "mc_y": (2, 3, 4, 5),
    "I_yy": (1, 2, 3, 4, 5),
    "I_zz": (2, 3, 4, 5),
    "I_xy": (2, 3, 4, 5),
    "I_xz": (3, 4, 5),
    "I_yz": (3, 4, 5),
}
PRIORITY = Priority(tuple(f"link{i}.{kind}" for kind in TABLE_11 for i in range(1, 6)))
KEPT = {f"link{i}.{kind}" for kind, links in TABLE_12.items() for i in links}


@cache
def space(name: str) -> EssentialSpace:
    return essential_space(load(name))


def test_rank_26_and_table_12() -> None:
    found = space("semi_direct_drive")
    assert found.rank == len(KEPT) == 26
    assert found.certificate.gap > 1e11
    basis = fundamental_basis(found, PRIORITY)
    assert set(basis.names) == KEPT
    assert basis.scaled_condition < 10.0


@pytest.mark.parametrize("seed", mostly_at_night(range(20), *range(4)))
def test_rank_26_and_table_12_for_any_lengths(seed: int) -> None:
    """On both assembly branches in turn: generic lengths have the same rank on each."""
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.2, 0.6, 4)
    while not closes_everywhere(lengths):
        lengths = rng.uniform(0.2, 0.6, 4)
    found = essential_space(five_bar(lengths, near=bool(seed % 2)))
    assert found.rank == 26
    assert set(fundamental_basis(found, PRIORITY).names) == KEPT


def test_a_parallelogram_has_18_and_26_on_its_other_branch() -> None:
    assert space("semi_direct_drive_parallelogram").rank == 18
    lengths = np.array([0.45, 0.30, 0.45, 0.30])
    ranks = {near: essential_space(five_bar(lengths, near)).rank for near in (False, True)}
    assert ranks == {False: 18, True: 26}


def test_the_parallelogram_is_one_everywhere() -> None:
    arm = load("semi_direct_drive_parallelogram")
    q = arm.configuration(states_within_limits(arm, 50).p)
    opening = q[:, 1] - q[:, 2]
    np.testing.assert_allclose(q[:, 3], opening, atol=1e-12)  # link 4 along link 2
    np.testing.assert_allclose(q[:, 4], math.pi - opening, atol=1e-12)  # link 5 against link 3


@pytest.mark.parametrize("name", ["semi_direct_drive", "semi_direct_drive_parallelogram"])
def test_ranges_of_table_9(name: str) -> None:
    arm = load(name)
    limits = [joint.limits for joint in arm.primary_joints]
    assert [joint.name for joint in arm.primary_joints] == ["joint1", "joint2", "joint3"]
    assert [(x.lower, x.upper) for x in limits[:2]] == [(-2.793, 2.793), (-3.927, 0.785)]
    assert [x.velocity for x in limits] == [25.133, 35.343, 35.343]
    # Joint 3's range is the condition's shadow: no position that keeps the condition is lost.
    assert (limits[2].lower, limits[2].upper) == pytest.approx((-3.927 - WIDE, 0.785 - NARROW))
    p = np.array([[0.0, -1.0, -1.0 - x] for x in (0.52, 0.53, 2.61, 2.62)])
    assert arm.description.within_conditions(p).tolist() == [False, True, True, False]


@pytest.mark.parametrize("name", ["semi_direct_drive", "semi_direct_drive_parallelogram"])
def test_every_sample_within_table_9_can_be_reached(name: str) -> None:
    arm = load(name)
    corners = [(x, y, y - angle) for x in (-2.793, 2.793) for y in (-3.927, 0.785) for angle in (NARROW, WIDE)]
    q = arm.configuration(np.array(corners))
    assert arm.continuation is not None
    assert arm.continuation.regularity(q).min() > 0.3
    states = states_within_limits(arm, 200)
    opening = states.p[:, 1] - states.p[:, 2]
    assert opening.min() > NARROW
    assert opening.max() < WIDE
    assert np.ptp(opening) > 0.9 * (WIDE - NARROW)


def test_lengths_leave_room_over_all_of_table_9() -> None:
    """As the file says: the ends of links 2 and 3 stay within what links 4 and 5 span."""
    assert closes_everywhere(np.array([0.45, 0.30, 0.37, 0.41]), margin=0.07)
    ends = [spread(0.45, 0.30, x) for x in (NARROW, WIDE)]
    assert ends == pytest.approx([0.242, 0.725], abs=5e-4)


@pytest.mark.parametrize("opening", [0.0, math.pi])
def test_a_parallelogram_that_stretches_or_folds_raises(opening: float) -> None:
    """Where it could go over to the antiparallelogram, whichever way it came: no number is returned there."""
    arm = load("semi_direct_drive_parallelogram")
    for beyond in (-0.3, 0.0, 0.3):
        with pytest.raises(SingularityError, match=r"the loops are near a singularity at p = \[0\.0, -1\.\d*, -"):
            arm.configuration([0.0, -1.5, -1.5 - opening - math.copysign(beyond, opening - 1.0)])


def test_frames_are_the_papers() -> None:
    """Link 1's y axis is vertical, all other joints turn about one horizontal direction, both motors on one axis."""
    arm = load("semi_direct_drive")
    np.testing.assert_array_equal(arm.links[0].parent_to_joint.rotation @ [0, 1, 0], [0, 0, -1])
    np.testing.assert_array_equal(np.abs(arm.links[0].joint.axis), [0, 1, 0])
    for link in arm.links[1:]:
        np.testing.assert_array_equal(link.joint.axis, [0, 0, 1])
        np.testing.assert_array_equal(link.parent_to_joint.rotation, np.eye(3))
    assert arm.links[1].parent_to_joint == arm.links[2].parent_to_joint
    assert arm.description.parents == (-1, 0, 0, 2, 3)
    assert (len(arm.links), arm.dof) == (5, 3)


Body = tuple[float, Array, Array]
PLANES = {2: 0.06, 3: -0.12, 4: -0.06, 5: 0.0}


def tube(length: float, z: float) -> Body:
    """Aluminium, 80 mm outside and 70 mm inside, along x from the frame."""
    outer, inner = 0.04, 0.035
    mass = 2700.0 * math.pi * (outer**2 - inner**2) * length
    radii = outer**2 + inner**2
    across = mass * (3.0 * radii + length**2) / 12.0
    return mass, np.array([length / 2.0, 0.0, z]), np.diag([mass * radii / 2.0, across, across])


def disc(z: float) -> Body:
    """A rotor of 10 kg about z."""
    across = 10.0 * (3.0 * 0.12**2 + 0.08**2) / 12.0
    return 10.0, np.array([0.0, 0.0, z]), np.diag([across, across, 10.0 * 0.12**2 / 2.0])


def ball(x: float) -> Body:
    return 1.0, np.array([x, 0.0, 0.0]), 0.4 * 0.04**2 * np.eye(3)


def pillar() -> Body:
    across = 40.0 * (3.0 * 0.15**2 + 0.4**2) / 12.0
    return 40.0, np.array([0.0, 0.2, 0.0]), np.diag([across, 40.0 * 0.15**2 / 2.0, across])


@pytest.mark.parametrize(
    ("name", "lengths"),
    [
        ("semi_direct_drive", (0.45, 0.30, 0.37, 0.41)),
        ("semi_direct_drive_parallelogram", (0.45, 0.30, 0.45, 0.30)),
    ],
)
def test_inertias_follow_the_rule_that_the_file_states(name: str, lengths: tuple[float, ...]) -> None:
    arm = load(name)
    l2, l3, l4, l5 = lengths
    bodies = [
        [pillar()],
        [tube(l2, PLANES[2]), disc(PLANES[2])],
        [tube(l3, PLANES[3]), disc(PLANES[3])],
        [tube(l4, PLANES[4])],
        [tube(l5 + 0.5, PLANES[5]), ball(l5 + 0.5)],
    ]
    for link, parts in zip(arm.links, bodies, strict=True):
        expected = np.sum([from_center_of_mass(*part) for part in parts], axis=0)
        np.testing.assert_allclose(link.inertia, expected, rtol=1e-5, atol=1e-6)
    assert arm.description.inconsistent_links == ()


def test_motors_carry_the_arm() -> None:
    """Holding still takes less than a fifth of any motor, everywhere within Table 9."""
    arm = load("semi_direct_drive")
    p = states_within_limits(arm, 200).p
    holding = arm.inverse_dynamics(p, 0.0 * p, 0.0 * p)
    assert (np.abs(holding) < 0.2 * arm.effort_limits).all()
