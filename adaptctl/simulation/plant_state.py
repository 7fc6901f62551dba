"""The state of a plant between two control periods."""

from __future__ import annotations

from typing import NamedTuple

from adaptctl.arrays import Array


class PlantState(NamedTuple):
    """State of an arm of r primary (independent) joints at one `time` (s), what was measured of it, and the internal
    states of its drives' and sensors' effects; for many arms, arrays have leading axes. Nothing is checked.

    Positions `p` (r,) of the primary joints and `q` (n,) of all n joints of the spanning tree (p itself without loops),
    rad (m if prismatic); velocities `v` (r,), rad/s (m/s); `measured_p` and `measured_v` (r,), in the same units: the
    true ones if there are no sensors, the motors' where encoders sit on these.

    Of the last control period: `applied` (r,), N m (N), the torques that reached the joints, at time zero those that
    held them if there are actuator effects or springs, else 0; `clipped`, True if the torque commanded was beyond the
    plant's limits; `marks` (h,), one for each of the h effects named in `Plant.marks`, 1 if it changed a torque, else
    0.

    `drives` (d,) are the internal states of the actuator effects, one after the other, followed, with `ElasticJoints`,
    by the motors' positions (r,), rad (m), and velocities (r,), rad/s (m/s); `sensors` (s,) are those of the sensor
    effects. The lengths d and s are in `Plant.sizes`.
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
    """True if the torque commanded in the last period was beyond the plant's limits"""
    marks: Array
    """(h,) 1 for each of `Plant.marks` that changed a torque in the last period, else 0"""
    drives: Array
    """(d,) internal states of the actuator effects; with `ElasticJoints`, then the motors' positions (r,) and
    velocities (r,)"""
    sensors: Array
    """(s,) internal states of the sensor effects"""
