"""Right angles that files rounded: named, and made exact where torques hardly tell."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from random_trees import random_tree
from robot_files import urdf

from adaptctl.description import Description, Joint, Link, Pose, read, snapped
from adaptctl.description.pose import rotation_about
from adaptctl.description.right_angles import ROUNDED_ANGLE, near_right_angles
from adaptctl.description.writers.mechanism_file import write_mechanism
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.dynamics.rounded_angles import ROUNDED_TORQUE, _states, as_meant, torque_change
from adaptctl.errors import PlausibilityWarning, RankError, RoundedAnglesWarning
from adaptctl.identifiability import essential_space


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize("name", ["so100.urdf", "so101.urdf"])
def test_a_tilt_of_six_microradians_makes_38_of_36(name: str) -> None:
    """The first axis is not quite vertical in these files; gravity then tells two more parameters."""
    with pytest.raises(
        RankError, match=r"rank is 38 for the geometry as given, but 36 if .* gravity and shoulder_pan are"
    ):
        essential_space(Mechanism(read(urdf(name))))
    found = essential_space(load(urdf(name), as_written=True))
    assert found.rank == found.certificate.rank_exact == 38
    assert found.certificate.relative_smallest < 1e-3
    (first, *_) = found.certificate.near_right_angles
    assert (first.parent, first.child) == ("gravity", "shoulder_pan")
    assert 1e-6 < abs(first.deviation) < 1e-5
    assert "rad from" in str(first)
    words = r"taken as (a right angle|right angles); as_written=True keeps"
    with pytest.warns(RoundedAnglesWarning, match=words) as said:
        exact = essential_space(load(urdf(name)))
    assert len(said) == 1
    assert exact.rank == 36
    assert exact.certificate.near_right_angles == ()
    assert exact.certificate.relative_smallest > 1e-2


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
@pytest.mark.parametrize("name", ["icub.urdf", "romeo_laas_small.urdf", "tiago_pro.urdf", "xarm7.urdf"])
def test_real_files_are_straight_afterwards_and_hardly_moved(name: str) -> None:
    before = read(urdf(name))
    after = snapped(before)
    assert len(near_right_angles(before)) >= 6
    assert near_right_angles(after, exact=1e-15) == ()
    assert [link.name for link in after.links] == [link.name for link in before.links]
    np.testing.assert_array_equal(after.inertial_parameters, before.inertial_parameters)
    p = np.random.default_rng(0).uniform(-1, 1, Mechanism(before).dof)
    places = [link_poses(Mechanism(description), p).translations for description in (before, after)]
    assert np.abs(places[0] - places[1]).max() < 1e-4


def tilted(miss: float, gravity: float = 9.81) -> Description:
    """An arm whose shoulder is tilted by `miss` rad, so that gravity turns its first joint, which it did not."""
    arm = read("puma560_measured")
    first = arm.links[0]
    turn = Pose(rotation_about((1, 0, 0), miss), np.zeros(3))
    return replace(
        arm,
        gravity=np.array([0.0, 0.0, -gravity]),
        links=(replace(first, parent_to_joint=turn @ first.parent_to_joint), *arm.links[1:]),
    )


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PlausibilityWarning")
def test_angles_that_torques_tell_stay(tmp_path: Path) -> None:
    """Within 1e-4 rad: what moves torques by less than 1e-4 is rounded, what moves them by more is not."""
    for miss, gravity, rounded in ((1e-8, 9.81, True), (9e-5, 9.81, True), (9e-5, 25.0, False), (2e-4, 9.81, False)):
        file = tmp_path / "arm.toml"
        off = tilted(miss, gravity)
        write_mechanism(file, off)
        as_written = load(file, as_written=True)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", PlausibilityWarning)  # of gravity that the motors do not hold
            arm = load(file)
        assert (arm.geometry_sha256 != as_written.geometry_sha256) == bool(said) == rounded
        change = torque_change(off, snapped(off, 1e-3))
        assert (miss < ROUNDED_ANGLE and change < ROUNDED_TORQUE) == rounded
        assert essential_space(as_written, prove=True).certificate.rank_exact == 38
        if not rounded:
            with pytest.raises(RankError, match=r"38 for the geometry as given, but 36"):
                essential_space(arm)


def test_one_rounded_angle_is_told_as_one() -> None:
    with pytest.warns(RoundedAnglesWarning, match=r"^a file: 1 rounded angle taken"):
        as_meant(tilted(1e-6), "a file")


def test_the_change_of_torques_is_that_of_another_recursion() -> None:
    import pinocchio

    before, after = tilted(1e-5), read("puma560_measured")
    states = _states(before)
    torques = []
    for arm in (before, after):
        model = Mechanism(arm).to_pinocchio()
        data = model.createData()
        torques.append(np.array([pinocchio.rnea(model, data, *state) for state in zip(*states, strict=True)]))
    expected = (np.abs(torques[1] - torques[0]).max(0) / np.abs(torques[0]).max(0)).max()
    assert torque_change(before, after) == pytest.approx(expected, rel=1e-6)


def test_torques_are_compared_all_around_and_at_speeds_of_falling() -> None:
    """Within half a turn either way, and as fast as a metre falls: this arm has no lengths before its joints."""
    p, v, a = _states(read("puma560_measured"))
    assert (p.min(), p.max()) == pytest.approx((-np.pi, np.pi), rel=0.05)
    assert np.abs(p).max() <= np.pi
    assert (v.std(), a.std()) == pytest.approx((np.sqrt(9.81), 9.81), rel=0.15)


@pytest.mark.parametrize("name", ["puma560_measured", "semi_direct_drive", "semi_direct_drive_parallelogram"])
def test_what_is_exact_stays(name: str) -> None:
    assert snapped(read(name)) == read(name)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_ordinary_angles_stay(seed: int, links: int) -> None:
    tree = random_tree(seed, links).description
    assume(not near_right_angles(tree, exact=0.0))
    assert snapped(tree, 1e-9) == tree


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1e-8, 9e-4), st.integers(0, 3))
def test_a_joint_turned_a_little_off_is_turned_back(seed: int, miss: float, quarter: int) -> None:
    """In frames that are nowhere near right angles themselves."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    across = np.cross(axis, rng.normal(size=3))
    across /= np.linalg.norm(across)
    first = Link("a", -1, Joint("one", axis=axis), Pose.identity(), Pose.identity())
    turned = rotation_about(across, quarter * np.pi / 2 + miss) @ rotation_about(axis, 0.4)
    second = Link("b", 0, Joint("two", axis=axis), Pose(turned, np.zeros(3)), Pose.identity())
    off = Description("off", (first, second), np.zeros(3))
    (found,) = near_right_angles(off)
    assert abs(found.deviation) == pytest.approx(miss, rel=1e-5)
    straight = snapped(off)
    assert near_right_angles(straight, exact=1e-15) == ()
    assert np.abs(straight.links[1].parent_to_joint.rotation - turned).max() < 1.1 * miss
    again = snapped(straight).links[1].parent_to_joint.rotation
    np.testing.assert_allclose(again, straight.links[1].parent_to_joint.rotation, rtol=0, atol=1e-15)
