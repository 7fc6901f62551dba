"""Motions that a robot can run: from rest to rest, within its limits, and telling of its parameters on the way."""

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
from adaptctl.control.excitation.excitation_trajectory import MotionLimits, excitation_trajectory
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.files import write_text
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis

BLEND = np.polynomial.Polynomial([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])
"""From 0 to 1 with three derivatives zero at both ends."""
RATE = 250.0
"""Hz, at which limits are looked at."""
SLOWEST = 100.0
HALVINGS = 12
Allowed = Callable[[Array], bool]
"""A test that is true if all positions (n, r) are allowed."""


@dataclass(frozen=True, eq=False)
class RobotLimits:
    """Limits of a robot's motion, largest magnitudes (r,) each for r joints, infinite where there is none: `velocity`
    (rad/s, or m/s for a prismatic joint), `acceleration` (rad/s^2 or m/s^2), `jerk`, the acceleration's rate (rad/s^3
    or m/s^3), and `torque` (N m or N). Nothing is checked at construction."""

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
        """The limits, a `RobotLimits`, of a `mechanism`: `share`, a fraction (unitless, not checked), of its own speed
        and torque limits, and limits of `acceleration` (rad/s^2, or m/s^2 for a prismatic joint) and `jerk` (rad/s^3 or
        m/s^3) as given. These are one number for all r joints or (r,), infinite or None for no limit. Raises
        `InputError` for another shape and what is not positive, `NonFiniteError` for NaN."""
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
    """Motion of a robot with r joints: a periodic reference, entered from rest at one pose and left to rest at another.

    Positions are p(t) = (1 - b) pose + b s. Here s is the `reference` (rad, or m for a prismatic joint) without its own
    fade-in, its time beginning as the first blend ends, and b is a polynomial that goes from 0 to 1 in the first `fade`
    s and back in the last; the pose is `start` (r,) in the first half and `end` (r,) in the second, rad (m). `period`
    (s) is the time between these blends, and all of it is `slower` (unitless, 1 by default) times slower. Nothing is
    checked at construction.
    """

    reference: Sinusoids
    start: Array
    end: Array
    period: float
    fade: float
    time_scale: float = 1.0

    @property
    def duration(self) -> float:
        """Duration of the whole motion, s: its factor `slower` times the sum of its `period` and of both blends, `fade`
        each."""
        return self.time_scale * (self.period + 2.0 * self.fade)

    def at(self, time: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """Positions (rad, or m for a prismatic joint), velocities (rad/s, m/s), accelerations (rad/s^2, m/s^2) and
        jerks (rad/s^3, m/s^3) of the motion, (n, r) each for r joints, at n times `time` (n,) in s from its start.
        Before and after the motion the robot rests at its first and last pose. Raises `IndexError` for a scalar
        time."""
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

    def sampled(self, rate: float = RATE) -> tuple[Array, Array, Array, Array, Array]:
        """Times (n,) in s, evenly from 0 to the motion's end, about `rate` a second (Hz, 250 by default), and the
        motion there: a tuple of five arrays. The others are (n, r) each for r joints: positions (rad, or m for a
        prismatic joint), velocities (rad/s, m/s), accelerations (rad/s^2, m/s^2) and jerks (rad/s^3, m/s^3). n is at
        least 3; the rate is not checked."""
        time = np.linspace(0.0, self.duration, max(2, round(self.duration * rate)) + 1)
        return time, *self.at(time)

    def _swing(self, t: Array) -> list[Array]:
        """The reference and its three derivatives (n, r)."""
        phase = np.zeros(1) if self.reference.phase is None else self.reference.phase
        angle = 2.0 * np.pi * self.reference.frequency * t[:, None, None] + phase
        omega = 2.0 * np.pi * self.reference.frequency
        waves = [
            np.sum(self.reference.amplitude * omega**k * np.sin(angle + 0.5 * np.pi * k), axis=-2) for k in range(4)
        ]
        return [waves[0] + self.reference.center, *waves[1:]]


def _blend(x: Array, rate: float) -> list[Array]:
    """The blend and its three derivatives over time, of its argument x clipped to 0..1."""
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
) -> RobotMotion:
    """A motion, a `RobotMotion`, that excites a mechanism's parameters for an identification, within the `limits` of
    its r joints. It is a periodic excitation trajectory, entered from rest at a pose `start` (r,) and left to rest at
    `end` (r,), rad (m for a prismatic joint), by default (None) the middle of the joints' ranges.

    The reference has `harmonics` (5 by default) of the frequency 1/(`duration` - 2 `fade`) Hz and is the best of a
    search of at most `iterations` (10) steps, started from references drawn by `seed` (0; equal seeds give equal
    motions), within a fraction `share` (unitless, 0.8) of the joints' own ranges, speeds and torques. `duration` (s,
    14) is that of the whole motion, `fade` (s, 2) of each blend; the motion takes longer where it must be slowed until
    its speeds, accelerations, jerks and torques, friction included, are within `limits`. `allowed` is a function that
    is True if all of n positions (n, r) are allowed, such as free of collisions: the reference is made smaller until it
    is True. None allows all.

    Raises `InputError` for a duration that is not positive and finite, a fade that is not above 0 and below half the
    duration, harmonics and iterations other than whole numbers of at least 1, a seed other than one of at least 0, a
    share not above 0 and up to 1, poses of a wrong shape, outside the joints' ranges, not allowed, or whose gravity
    torques are beyond the torque limits, and where no motion is found; `NonFiniteError` for poses not finite,
    `RankError` where the number of identifiable parameters cannot be certified.
    """
    positive_number(duration, "duration: expected a positive number of seconds")
    if not 0.0 < 2.0 * fade < duration:
        raise InputError(f"fade: expected a time up to half of the duration of {duration:g} s, got {fade:g}")
    model = ReducedModel(mechanism, fundamental_basis(essential_space(mechanism)))
    space = MotionLimits.of(model, limit_share)
    middle = 0.5 * (space.lower + space.upper)
    first, last = (middle if pose is None else checked(pose, mechanism.dof, "pose") for pose in (start, end))
    _validate_poses(mechanism, first, last, limits, allowed)
    period = duration - 2.0 * fade
    found = excitation_trajectory(
        model,
        frequency=1.0 / period,
        harmonics=harmonics,
        limit_share=limit_share,
        limits=space,
        iterations=iterations,
        seed=seed,
    )
    motion = RobotMotion(found.reference, first, last, period, fade)
    return _slowed(_smaller(motion, allowed), mechanism, limits)


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
            raise InputError(f"{what}: joint {joint.name!r} cannot hold the pose within its share of the torque limit")
        if allowed is not None and not allowed(pose[None]):
            raise InputError(f"{what}: the pose collides, or leaves the workspace")


def _smaller(motion: RobotMotion, allowed: Allowed | None) -> RobotMotion:
    """The motion with the reference's swing about the start shrunk until it is allowed. Raises `InputError` if none
    is."""
    if allowed is None or allowed(motion.sampled(50.0)[1]):
        return motion
    share = 1.0
    for _ in range(HALVINGS):
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
    raise InputError("no motion between these poses is free of collisions and within the workspace; choose others")


def _slowed(motion: RobotMotion, mechanism: Mechanism, limits: RobotLimits) -> RobotMotion:
    """The motion slowed down until the limits allow it; unchanged if they do. Raises `InputError` beyond SLOWEST."""
    if _use(motion, mechanism, limits) <= 1.0:
        return motion
    slow, fast = 1.0, 1.0
    while _use(time_scaled(motion, slow), mechanism, limits) > 1.0:
        fast, slow = slow, 1.5 * slow
        if slow > SLOWEST:
            raise InputError(
                f"{mechanism.name}: even slowly the motion's torques pass their limits; narrow the positions (share)"
            )
    for _ in range(HALVINGS):
        middle = 0.5 * (slow + fast)
        slow, fast = (middle, fast) if _use(time_scaled(motion, middle), mechanism, limits) <= 1.0 else (slow, middle)
    return time_scaled(motion, slow)


def time_scaled(motion: RobotMotion, time_scale: float) -> RobotMotion:
    """A copy of a `motion`, a `RobotMotion`, on the same path at another pace: `slower` (unitless), the factor by which
    times are longer than its reference's, replaces its own: at 2 the motion takes twice as long. The number is not
    checked."""
    return RobotMotion(motion.reference, motion.start, motion.end, motion.period, motion.fade, time_scale)


def _use(motion: RobotMotion, mechanism: Mechanism, limits: RobotLimits) -> float:
    """The largest of speeds, accelerations, jerks and torques over their limits."""
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
    """Write a robot's `motion` to the file `path` as CSV, sampled evenly from its start to its end at about a `rate`
    (Hz), numbers to nine digits. The columns are `time` (s), then `position.J` (rad, or m for a prismatic joint),
    `velocity.J` (rad/s, m/s) and `acceleration.J` (rad/s^2, m/s^2) of each joint J in `joints`, the names in the
    motion's order. Raises `FileError` where the file cannot be written; names and rate are not checked."""
    time, p, v, a, _ = motion.sampled(rate)
    names = [f"{what}.{joint}" for what in ("position", "velocity", "acceleration") for joint in joints]
    rows = np.column_stack([time, p, v, a])
    lines = [",".join(["time", *names]), *(",".join(f"{x:.9g}" for x in row) for row in rows.tolist())]
    write_text(path, "\n".join(lines) + "\n")


def joint_trajectory(motion: RobotMotion, joints: Sequence[str], rate: float) -> dict[str, Any]:
    """The fields of a ROS 2 trajectory_msgs/JointTrajectory message, a dict of JSON's types, of a robot's `motion`,
    sampled evenly from its start to its end at about a `rate` (Hz), numbers to nine digits. They are `header`, with a
    stamp of 0 and no frame, `joint_names`, which are `joints`, and `points`, each with `time_from_start`, 0 for the
    first (sec and nanosec), and the joints' `positions` (rad, or m for a prismatic joint), `velocities` (rad/s, m/s)
    and `accelerations` (rad/s^2, m/s^2). Names and rate are not checked."""
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
    """Write a robot's motion, sampled evenly from its start to its end at about a `rate` (Hz), as the fields of a ROS 2
    trajectory_msgs/JointTrajectory message: as JSON to a path with the suffix .json, else as YAML, which `ros2 topic
    pub` takes. `joints` are the joints' names in the motion's order. Raises `FileError` where the file cannot be
    written; names and rate are not checked."""
    content = joint_trajectory(motion, joints, rate)
    as_json = Path(path).suffix == ".json"
    write_text(path, json.dumps(content, indent=1) + "\n" if as_json else _yaml(content))


def _yaml(content: dict[str, Any]) -> str:
    """YAML of a message's fields, with its points in the flow style, which is JSON."""
    head = {name: content[name] for name in ("header", "joint_names")}
    lines = [f"{name}: {json.dumps(value)}" for name, value in head.items()]
    return "\n".join([*lines, "points:", *(f"- {json.dumps(point)}" for point in content["points"])]) + "\n"


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{x:.9g}") for x in values.tolist()]
