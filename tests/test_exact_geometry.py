"""Lengths and frames in exact scalars: units, lengths that are nearly equal, and entries that are nothing."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from adaptctl.description import Description, Joint, Link, Pose
from adaptctl.description.pose import rotation_about
from adaptctl.identifiability.proof.exact_geometry import ExactGeometry, Reading
from adaptctl.identifiability.proof.joint_frames import AS_GIVEN, AS_MEANT, turns_of
from adaptctl.scalars import Mat, Vec


@pytest.mark.parametrize("unit", [Fraction(1), Fraction(1, 1000), Fraction(5, 2)])
def test_a_length_is_told_in_the_unit(unit: Fraction) -> None:
    reading = Reading(lambda x: x, 1.0, unit)
    assert reading.length(0.3) * unit == Fraction(3, 10)
    assert reading.length(-0.3) == -reading.length(0.3)
    assert reading.length(0.0) == 0


def test_a_length_next_to_a_shorter_one_is_that_one_and_keeps_its_sign() -> None:
    """By at most a ten thousandth of the mechanism, here 2 m long; never next to a longer one."""
    reading = Reading(lambda x: x, 2.0, precision=AS_MEANT, equal=(0.25, 0.5))
    for x, expected in ((0.50015, 0.5), (-0.50015, -0.5), (0.25, 0.25), (0.2501, 0.25)):
        assert float(reading.length(x)) == expected
    for x in (0.5003, 0.4999, 0.1):
        assert float(reading.length(x)) != 0.5
        assert float(reading.length(x)) == pytest.approx(x, abs=2e-4)


def test_an_entry_up_to_the_precision_is_a_zero_of_a_rotation() -> None:
    """Two turns where the least entry is as small as the precision, and three, which keep no zero, where it is not."""
    rotation = rotation_about(np.array([0.6, 0.0, 0.8]), 0.9) @ rotation_about(np.array([0.0, 1.0, 0.0]), 0.3)
    least = float(np.abs(rotation).min())
    for share, turns in ((1.0, 2), (0.99, 3)):
        assert len(turns_of(Mat.of(rotation.tolist()), AS_GIVEN._replace(angle=share * least))) == turns


def test_a_frame_that_is_not_turned_is_no_factor() -> None:
    """Between frames that are parallel in the file nothing is multiplied, and the turned one keeps its rotation."""
    quarter = Pose(rotation_about(np.array([0.0, 0.0, 1.0]), np.pi / 2), np.zeros(3))
    frames = [Pose(np.eye(3), np.array([0.3, 0.0, 0.1])), quarter, Pose.identity()]
    links = [Link(f"link{i}", i - 1, Joint(f"joint{i}"), near, frames[0], np.ones(10)) for i, near in enumerate(frames)]
    geometry = ExactGeometry.by_frames(Description("three", tuple(links)), Reading(float, 1.0))
    assert [segment.inward is None for segment in geometry.links] == [True, False, True]
    assert all(segment.outward is None for segment in geometry.links)
    assert geometry.links[1].inward is not None
    assert [*(geometry.links[1].inward @ Vec(0.0, 1.0, 0.0))] == [1.0, 0.0, 0.0]
