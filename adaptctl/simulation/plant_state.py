"""The state of a plant between two control periods."""

from __future__ import annotations

from typing import NamedTuple

from adaptctl.arrays import Array


class PlantState(NamedTuple):
    """State of an arm of r joints at one time, what was measured of it, and the memory of its drives and sensors; of
    many arms with leading axes. Without sensors, what is measured is the truth, of the motors where encoders sit there.
    """

    time: float
    """s"""
    p: Array
    """(r,) positions of the primary joints, rad (m)"""
    v: Array
    """(r,) their velocities, rad/s (m/s)"""
    q: Array
    """(n,) positions of all the tree's joints; p where there are no loops"""
    measured_p: Array
    """(r,) measured positions"""
    measured_v: Array
    """(r,) measured velocities"""
    applied: Array
    """(r,) N m (N), the torques that reached the joints in the last period"""
    clipped: bool
    """whether the torque commanded in the last period was beyond the plant's limits"""
    marks: Array
    """(m,) 1 for each of `Plant.marks` that held a torque back in the last period, else 0"""
    drives: Array
    """memory of the actuator effects; with `ElasticJoints`, then the motors' positions (r,) and velocities (r,)"""
    sensors: Array
    """memory of the sensor effects"""
