"""The state of a plant between two control periods."""

from __future__ import annotations

from typing import NamedTuple

from adaptctl.arrays import Array


class PlantState(NamedTuple):
    """State of an arm of r joints at one `time` (s), what was measured of it, and the memory of its drives and sensors;
    of many arms with leading axes.

    Positions `p` (r,) of the primary joints and `q` (n,) of all the tree's joints (p itself without loops), rad (m);
    velocities `v` (r,), rad/s (m/s); `measured_p` and `measured_v` (r,), in the same units: without sensors the true
    ones, of the motors where encoders sit there. Of the last period: `applied` (r,), N m (N), the torques that reached
    the joints, at time zero those that held them where actuator effects or springs ask, else 0; `clipped`, True if the
    torque commanded was beyond the plant's limits; `marks` (m,), 1 for each effect named in `Plant.marks` that changed
    a torque, else 0. `drives` (d,) is the memory of the actuator effects, with `ElasticJoints` then the motors'
    positions (r,), rad (m), and velocities (r,), rad/s (m/s); `sensors` (s,) that of the sensor effects; d and s are in
    `Plant.sizes`.
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
