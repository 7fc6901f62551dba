"""Motions that a robot can run."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, per_joint, positive_number
from adaptctl.control.excitation.excitation_trajectory import Motion, excitation_trajectory
from adaptctl.control.excitation.motion_limits import MotionLimits
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.files import write_text
from adaptctl.identifiability import ReducedModel
from adaptctl.identification.regular_range import keeps_regular, regular_limits

# From 0 to 1 with three derivatives zero at both ends.
BLEND = np.polynomial.Polynomial([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])
# Hz, at which limits are looked at.
CHECK_RATE = 250.0
MAX_TIME_SCALE = 100.0
MAX_HALVINGS = 12
MAX_DURATION = 1e4  # s, at CHECK_RATE some millions of points
# A test that is true if all positions (n, r) are allowed.
Allowed = Callable[[Array], bool]


@dataclass(frozen=True, eq=False)
class RobotLimits:
    """
    Limits of a robot's motion, infinite where there is none.

    Nothing is checked at construction.

    Parameters
    ----------
    velocity : numpy.ndarray
        Largest speeds (r,) in rad/s, or m/s for a prismatic joint.
    acceleration : numpy.ndarray
        Largest accelerations (r,) in rad/s^2 or m/s^2.
    jerk : numpy.ndarray
        Largest rates (r,) of acceleration in rad/s^3 or m/s^3.
    torque : numpy.ndarray
        Largest torques (r,) in N m, or forces in N.

    Examples
    --------
    >>> from adaptctl.identification.robot_motion import RobotLimits
    >>> RobotLimits.of(arm, 0.5, acceleration=20.0).torque.tolist()
    [30.0, 12.5]
    """

    velocity: Array
    acceleration: Array
    jerk: Array
    torque: Array

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        limit_share: float,
        acceleration: ArrayLike | None = None,
        jerk: ArrayLike | None = None,
    ) -> RobotLimits:
        """
        Return a share of a mechanism's own limits, with limits of acceleration and jerk.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r joints.
        limit_share : float
            Fraction of its speed and torque limits.
        acceleration : array_like, optional
            Limit, one or (r,), in rad/s^2 or m/s^2; none by default.
        jerk : array_like, optional
            Limit, one or (r,), in rad/s^3 or m/s^3; none by default.

        Returns
        -------
        RobotLimits
            Limits of all joints.

        Raises
        ------
        InputError
            If a shape is wrong or a limit is not positive (`NonFiniteError` for NaN).
        """
        speeds = np.array([joint.limits.velocity for joint in mechanism.primary_joints])
        bends = _each(acceleration, mechanism.dof, "acceleration")
        return cls(
            limit_share * speeds, bends, _each(jerk, mechanism.dof, "jerk"), limit_share * mechanism.effort_limits
        )


def _each(limit: ArrayLike | None, dof: int, what: str) -> Array:
    values = np.full(dof, np.inf) if limit is None else per_joint(limit, dof, what)
    if not np.all(values > 0.0):
        raise InputError(f"{what}: expected positive numbers, got {values.tolist()}")
    return values


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """
    Motion from rest at one pose, along a periodic reference, to rest at another.

    Nothing is checked at construction.

    Parameters
    ----------
    reference : Sinusoids
        Periodic reference of r joints, whose time begins after the first blend.
    start : numpy.ndarray
        First pose (r,) in rad, or m for a prismatic joint.
    end : numpy.ndarray
        Last pose (r,) in rad or m.
    period : float
        Time in s between the blends.
    fade : float
        Time in s of each blend.
    time_scale : float, default 1.0
        Factor by which the motion is slower than its reference.

    Notes
    -----
    Positions are :math:`(1 - b) p_0 + b s` with the reference :math:`s`, the pose :math:`p_0` and a polynomial
    :math:`b` that rises from 0 to 1 in the first blend and falls back in the last.

    Examples
    --------
    >>> from adaptctl.identification.robot_motion import RobotMotion
    >>> motion = RobotMotion(reference, np.zeros(2), np.zeros(2), period=10.0, fade=2.0)
    >>> motion.duration, motion.at([0.0, 5.0])[0].shape
    (14.0, (2, 2))
    """

    reference: Sinusoids
    start: Array
    end: Array
    period: float
    fade: float
    time_scale: float = 1.0

    def __repr__(self) -> str:
        return f"<RobotMotion of {len(self.start)} joints: {self.duration:.3g} s>"

    @property
    def duration(self) -> float:
        """Duration of the whole motion in s, both blends included."""
        return self.time_scale * (self.period + 2.0 * self.fade)

    def at(self, time: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """
        Compute the motion at given times.

        Parameters
        ----------
        time : array_like
            Times (n,) in s from the motion's start; before and after it the robot rests.

        Returns
        -------
        tuple of numpy.ndarray
            Positions (n, r) in rad (m for a prismatic joint), and their first three derivatives.
        """
        t = np.asarray(time, dtype=np.float64) / self.time_scale
        whole = self.period + 2.0 * self.fade
        entering, leaving = _blend(t / self.fade, 1.0 / self.fade), _blend((whole - t) / self.fade, -1.0 / self.fade)
        swing = self._swing(t - self.fade)
        late = (t > 0.5 * whole)[:, None]
        pose = np.where(late, self.end, self.start)
        b = [np.where(late, after[:, None], before[:, None]) for before, after in zip(entering, leaving, strict=True)]
        off = [swing[0] - pose, *swing[1:]]
        found = [sum(comb(k, i) * b[i] * off[k - i] for i in range(k + 1)) for k in range(4)]
        p, v, a, jerk = (found[k] / self.time_scale**k for k in range(4))
        return pose + p, v, a, jerk

    def sampled(self, rate: float = CHECK_RATE) -> tuple[Array, Array, Array, Array, Array]:
        """
        Sample the motion evenly from its start to its end.

        Parameters
        ----------
        rate : float, default 250.0
            Approximate rate in Hz.

        Returns
        -------
        tuple of numpy.ndarray
            Times (n,) in s, positions (n, r) in rad (m), and their first three derivatives.
        """
        time = np.linspace(0.0, self.duration, max(2, round(self.duration * rate)) + 1)
        return time, *self.at(time)

    def _swing(self, t: Array) -> list[Array]:
        phase = np.zeros(1) if self.reference.phase is None else self.reference.phase
        angle = 2.0 * np.pi * self.reference.frequency * t[:, None, None] + phase
        omega = 2.0 * np.pi * self.reference.frequency
        waves = [
            np.sum(self.reference.amplitude * omega**k * np.sin(angle + 0.5 * np.pi * k), axis=-2) for k in range(4)
        ]
        return [waves[0] + self.reference.center, *waves[1:]]


def _blend(x: Array, rate: float) -> list[Array]:
    """Blend and its three derivatives over time, of its argument x clipped to 0..1."""
    inside = np.clip(x, 0.0, 1.0)
    return [BLEND.deriv(k)(inside) * rate**k if k else BLEND(inside) for k in range(4)]


def exciting_motion(
    mechanism: Mechanism,
    limits: RobotLimits,
    *,
    start: ArrayLike | None = None,
    end: ArrayLike | None = None,
    duration: float = 14.0,
    fade: float = 2.0,
    harmonics: int = 5,
    limit_share: float = 0.8,
    seed: int = 0,
    iterations: int = 10,
    allowed: Allowed | None = None,
    earlier: Motion | None = None,
) -> RobotMotion:
    """
    Design a motion that excites a mechanism's parameters within limits.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    limits : RobotLimits
        Limits of speeds, accelerations, jerks and torques, friction included.
    start : array_like, optional
        First pose (r,) in rad (m); the middle of the joints' ranges by default.
    end : array_like, optional
        Last pose (r,); the middle of the ranges by default.
    duration : float, default 14.0
        Duration in s, longer where limits require it.
    fade : float, default 2.0
        Time in s of each blend, below half the duration.
    harmonics : int, default 5
        Harmonics of the reference.
    limit_share : float, default 0.8
        Fraction of the joints' own ranges, speeds and torques that the reference uses.
    seed : int, default 0
        Seed of the search.
    iterations : int, default 10
        Largest number of search steps.
    allowed : callable, optional
        Function that is True if positions (n, r) are allowed, for instance free of collisions; all are by default.
    earlier : tuple of ndarray, optional
        Positions, velocities and accelerations (n, r) of an earlier log, 50 a second, to which the motion is to add
        what that left open.

    Returns
    -------
    RobotMotion
        Best motion found, made smaller and slower until it is allowed.

    Raises
    ------
    InputError
        If a number is out of range, a pose cannot be held or is not allowed, or no motion is found.
    RankError
        If the number of identifiable parameters cannot be certified.
    KeyboardInterrupt
        If Ctrl-C ended the search.

    Examples
    --------
    >>> from adaptctl.identification.robot_motion import RobotLimits, exciting_motion
    >>> motion = exciting_motion(arm, RobotLimits.of(arm, 1.0), harmonics=2, iterations=1)
    >>> motion.duration >= 14.0
    True
    """
    positive_number(duration, "duration: expected a positive number of seconds", most=MAX_DURATION)
    if not 0.0 < 2.0 * fade < duration:
        raise InputError(f"duration: expected more than {2.0 * fade:g} s, twice the fade, got {duration:g}")
    model = ReducedModel(mechanism)
    space = regular_limits(mechanism, MotionLimits.from_model(model, limit_share))
    allowed = _regular(mechanism, allowed)
    middle = 0.5 * (space.lower + space.upper)
    middle = middle if space.axes is None else space.axes @ middle
    first, last = (
        middle if pose is None else checked(pose, mechanism.dof, what)
        for what, pose in (("start", start), ("end", end))
    )
    _validate_poses(mechanism, first, last, limits, allowed)
    period = duration - 2.0 * fade
    found = excitation_trajectory(
        model,
        frequency=1.0 / period,
        harmonics=harmonics,
        limit_share=limit_share,
        limits=space,
        earlier=earlier,
        iterations=iterations,
        seed=seed,
    )
    if not found.complete:
        raise KeyboardInterrupt
    motion = RobotMotion(found.reference, first, last, period, fade)
    return _slowed(_smaller(motion, allowed), mechanism, limits)


def _regular(mechanism: Mechanism, allowed: Allowed | None) -> Allowed | None:
    """Function that is True for positions that are allowed and away from singularities of closed loops."""
    if mechanism.continuation is None:
        return allowed
    return lambda p: bool(keeps_regular(mechanism, p).all()) and (allowed is None or allowed(p))


def _validate_poses(
    mechanism: Mechanism, start: Array, end: Array, limits: RobotLimits, allowed: Allowed | None
) -> None:
    still = np.zeros(mechanism.dof)
    for what, pose in (("start", start), ("end", end)):
        for joint, place in zip(mechanism.primary_joints, pose.tolist(), strict=True):
            if not joint.limits.lower <= place <= joint.limits.upper:
                raise InputError(
                    f"{what}: joint {joint.name!r} at {place:g} is outside its range, {joint.limits.lower:g} to "
                    f"{joint.limits.upper:g}"
                )
        held = np.abs(mechanism.inverse_dynamics(pose, still, still))
        if np.any(held > limits.torque):
            joint = mechanism.primary_joints[int(np.argmax(held - limits.torque))]
            raise InputError(
                f"{what}: joint {joint.name!r} cannot hold the pose within its fraction of the torque limit"
            )
        if allowed is not None and not allowed(pose[None]):
            raise InputError(f"{what}: the pose collides, leaves the workspace, or is near a singularity of the loops")


def _smaller(motion: RobotMotion, allowed: Allowed | None) -> RobotMotion:
    if allowed is None or allowed(motion.sampled(50.0)[1]):
        return motion
    share = 1.0
    for _ in range(MAX_HALVINGS):
        share *= 0.75
        reference = motion.reference
        nearer = Sinusoids(
            motion.start + share * (reference.center - motion.start),
            share * reference.amplitude,
            reference.frequency,
            reference.phase,
            start_time=0.0,
        )
        smaller = RobotMotion(nearer, motion.start, motion.end, motion.period, motion.fade)
        if allowed(smaller.sampled(50.0)[1]):
            return smaller
    raise InputError("no collision-free motion between these poses within the workspace; give other poses")


def _slowed(motion: RobotMotion, mechanism: Mechanism, limits: RobotLimits) -> RobotMotion:
    if _use(motion, mechanism, limits) <= 1.0:
        return motion
    slow, fast = 1.0, 1.0
    while _use(time_scaled(motion, slow), mechanism, limits) > 1.0:
        fast, slow = slow, 1.5 * slow
        if slow > MAX_TIME_SCALE:
            raise InputError(
                f"{mechanism.name}: the torques exceed their limits even for a slow motion; reduce the position range "
                "(limit_share)"
            )
    for _ in range(MAX_HALVINGS):
        middle = 0.5 * (slow + fast)
        slow, fast = (middle, fast) if _use(time_scaled(motion, middle), mechanism, limits) <= 1.0 else (slow, middle)
    return time_scaled(motion, slow)


def time_scaled(motion: RobotMotion, time_scale: float) -> RobotMotion:
    """Copy of a motion on the same path, `time_scale` times slower than its reference."""
    return RobotMotion(motion.reference, motion.start, motion.end, motion.period, motion.fade, time_scale)


def _use(motion: RobotMotion, mechanism: Mechanism, limits: RobotLimits) -> float:
    _, p, v, a, jerk = motion.sampled()
    torque = mechanism.inverse_dynamics(p, v, a)
    pairs = (
        (v, limits.velocity),
        (a, limits.acceleration),
        (jerk, limits.jerk),
        (torque, limits.torque),
    )
    return max(float((np.abs(values) / limit).max()) for values, limit in pairs)


def write_csv(path: str | Path, motion: RobotMotion, joints: Sequence[str], rate: float) -> None:
    """Write a motion to a CSV file, sampled at about `rate` (Hz): time, positions, velocities and accelerations."""
    time, p, v, a, _ = motion.sampled(rate)
    names = [f"{what}.{joint}" for what in ("position", "velocity", "acceleration") for joint in joints]
    rows = np.column_stack([time, p, v, a])
    lines = [",".join(["time", *names]), *(",".join(f"{x:.9g}" for x in row) for row in rows.tolist())]
    write_text(path, "\n".join(lines) + "\n")


def joint_trajectory(motion: RobotMotion, joints: Sequence[str], rate: float) -> dict[str, Any]:
    """Fields of a ROS 2 trajectory_msgs/JointTrajectory message of a motion, sampled at about `rate` (Hz)."""
    time, p, v, a, _ = motion.sampled(rate)
    points = [
        {
            "positions": _rounded(p[i]),
            "velocities": _rounded(v[i]),
            "accelerations": _rounded(a[i]),
            "time_from_start": {"sec": int(t), "nanosec": min(round((t % 1.0) * 1e9), 999_999_999)},
        }
        for i, t in enumerate(time.tolist())
    ]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": list(joints), "points": points}


def write_trajectory(path: str | Path, motion: RobotMotion, joints: Sequence[str], rate: float) -> None:
    """Write a motion as a JointTrajectory message: JSON for the suffix .json, else YAML for `ros2 topic pub`."""
    content = joint_trajectory(motion, joints, rate)
    as_json = Path(path).suffix == ".json"
    write_text(path, json.dumps(content, indent=1) + "\n" if as_json else _yaml(content))


def _yaml(content: dict[str, Any]) -> str:
    head = {name: content[name] for name in ("header", "joint_names")}
    lines = [f"{name}: {json.dumps(value)}" for name, value in head.items()]
    return "\n".join([*lines, "points:", *(f"- {json.dumps(point)}" for point in content["points"])]) + "\n"


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{x:.9g}") for x in values.tolist()]
