"""A log made ready: even in time, without jumps, its velocities checked, where it moves."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import firwin, oaconvolve

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog

WIDTH = 2.0
"""Length of a kernel, in periods of its cut-off."""
DIFFERENCE = np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) / 12.0
"""Of fourth order, to convolve with: what it takes off a sine of a tenth of the rate is 0.5 %."""
AROUND = len(DIFFERENCE) // 2


def low_pass(cutoff: float, rate: float) -> Array:
    """The kernel (t,) of a low-pass filter without phase lag: symmetric weights that sum to 1, for a signal sampled at
    `rate` Hz. It halves the amplitude of a sine of `cutoff` Hz; t is 2 round(rate/cutoff) + 1. Raises `ValueError` for
    a cut-off below zero or not below half the rate, `ZeroDivisionError` for 0."""
    taps = 2 * round(0.5 * WIDTH * rate / cutoff) + 1
    return np.asarray(firwin(taps, cutoff, window=("kaiser", 5.0), fs=rate))


def padded(kernel: Array) -> Array:
    """The `kernel` (t,) of a filter, t weights, with two zeros before and two after, (t + 4,), so that it is as long as
    that of `derivative`. Nothing is checked."""
    return np.pad(kernel, AROUND)


def derivative(kernel: Array, rate: float) -> Array:
    """The kernel (t + 4,), 1/s, that gives the time derivative of a signal filtered by `kernel` (t,), t weights, by
    central differences of fourth order; `rate` is the signal's sampling rate (Hz). Its samples are at the same times as
    those of `padded(kernel)`, which filters the signal itself. Nothing is checked."""
    return np.convolve(kernel, DIFFERENCE) * rate


def filtered(signal: ArrayLike, kernel: Array, every: int = 1) -> Array:
    """The convolution (m, ...) of a `signal` (n, ...), along its first axis, with a filter's `kernel` (t,), in the
    signal's unit times the kernel's. It has the values at which the kernel lies wholly within the signal, n - t + 1 in
    all, or only every `every`-th of them (1 by default), beginning with the first; m is (n - t + 1)/every, rounded up.

    Nothing is assumed of the signal beyond its ends, so there is no transient. Raises `InputError` for a signal that is
    shorter than the kernel.
    """
    values = np.asarray(signal, dtype=np.float64)
    if len(values) < len(kernel):
        raise InputError(f"signal: expected at least {len(kernel)} samples, as the kernel has, got {len(values)}")
    flat = values.reshape(len(values), -1)
    if every == 1:
        out = oaconvolve(flat, kernel[:, None], mode="valid", axes=0)
    else:
        count = len(flat) - len(kernel) + 1
        out = sum((weight * flat[k : k + count : every] for k, weight in enumerate(kernel[::-1])), np.zeros(()))
    return np.asarray(out).reshape(-1, *values.shape[1:])


JITTER, GAP = 0.01, 8.0
"""Of a sampling period: what stamps may be off and still count as even, and what counts as a hole in the log."""
AGREEMENT = 0.1
"""Largest relative difference of logged velocities from differentiated positions."""
REST, SLOW, AT_REST = 0.01, 1e-3, 0.1
"""A joint slower than this share of its greatest speed, or so many rad/s (m/s), rests; when all do for so many s, the
arm is at rest."""
TOO_FAST, TOO_FAR = 3.0, 0.25
"""Times the greatest speed, and rad or m beyond the range, that a robot's file allows."""
SLOWEST, FASTEST = 20.0, 1e5
"""Hz, between which logs of arms are sampled."""
STEPS = ("resample", "unwrap", "velocities", "limits", "standstill")
"""Names of the steps that can be skipped."""


class PreparationStep(NamedTuple):
    """Step of a log's preparation: its `name` ("resample", "unwrap", "velocities", "limits" or "standstill") and its
    `outcome`, a text of what it found or did, "skipped" where it was left out. Made by `prepare`; nothing is checked at
    construction."""

    name: str
    outcome: str


@dataclass(frozen=True, eq=False)
class PreparedLog:
    """Piece of a log of a robot's r joints, without holes: n samples, evenly spaced at a `rate` in Hz (unless the step
    "resample" was skipped).

    `time` (n,) is in s, as in the log; `position` (n, r) in rad (m for a prismatic joint), without jumps of a turn
    (unless the step "unwrap" was skipped); `torque` (n, r) in N m (N); `moving` (n,) is True where the arm moves
    (everywhere if the step "standstill" was skipped). `source` is the log's file, as text. Made by `prepare`; nothing
    is checked at construction.
    """

    source: str
    rate: float
    time: Array
    position: Array
    torque: Array
    moving: NDArray[np.bool_]


def prepare(
    log: JointLog, mechanism: Mechanism, skip: Collection[str] = ()
) -> tuple[list[PreparedLog], list[PreparationStep]]:
    """The pieces of a log between holes in time, a list of `PreparedLog`, and the steps of their preparation, a list of
    `PreparationStep`, with those named in `skip` left out (none by default). A hole is a step of more than 8 times the
    median step; pieces of fewer than 50 samples are left out.

    "resample" makes samples evenly spaced, by straight lines between those logged; "unwrap" takes jumps of a turn out
    of angles; "velocities" compares logged velocities with differentiated positions; "limits" compares positions,
    speeds and torques with the joints' limits in `mechanism`; "standstill" flags where the whole arm is at rest, for
    0.1 s or longer: every joint no faster than 1 % of its greatest speed or, where that is less, than 1e-3 rad/s (m/s
    if prismatic). Raises `InputError` for an unknown step, a log without 50 samples in a row, a sampling rate not from
    20 Hz to 100 kHz, velocities of a joint that differ from its positions' derivative by more than 10 %, positions more
    than 0.25 rad (m) beyond limits, speeds or torques (99th percentiles) above three times theirs, and a log with fewer
    than 50 samples of motion.
    """
    _validate_known(skip)
    steps = [PreparationStep(name, "skipped") for name in STEPS if name in skip]
    pieces = list(_pieces(log))
    _validate_plausible_rate(log)
    if "resample" not in skip:
        done = [_resampled(piece) for piece in pieces]
        pieces = [piece for piece, _ in done]
        steps.append(PreparationStep("resample", _resampling([how for _, how in done], len(pieces))))
    if "unwrap" not in skip:
        turned = [_unwrapped(piece, mechanism) for piece in pieces]
        pieces = [piece for piece, _ in turned]
        steps.append(
            PreparationStep("unwrap", f"{sum(count for _, count in turned)} jumps of a turn taken out of the angles")
        )
    speeds = [_speed(piece) for piece in pieces]
    if "velocities" not in skip:
        steps.append(PreparationStep("velocities", _compared(log.source, pieces, speeds, mechanism)))
    if "limits" not in skip:
        steps.append(PreparationStep("limits", _within_limits(log.source, pieces, speeds, mechanism)))
    moving = [np.ones(len(piece), dtype=np.bool_) for piece in pieces]
    if "standstill" not in skip:
        moving = _moving(pieces, speeds)
        share = float(np.mean(np.concatenate(moving)))
        if share * sum(len(piece) for piece in pieces) < 50:
            raise InputError(f"{log.source}: the arm is at rest throughout: nothing but its weight is in the torques")
        steps.append(
            PreparationStep("standstill", f"{1.0 - share:.1%} of the samples dropped, where the whole arm is at rest")
        )
    return [_prepared(piece, where) for piece, where in zip(pieces, moving, strict=True)], steps


def _validate_known(skip: Collection[str]) -> None:
    if isinstance(skip, str):
        raise InputError(f"skip_steps: expected a list of names, got the text {skip!r}")
    if unknown := [name for name in skip if name not in STEPS]:
        raise InputError(f"skip_steps: expected {', '.join(STEPS)}, got {unknown[0]!r}")


def _validate_plausible_rate(log: JointLog) -> None:
    rate = 1.0 / float(np.median(np.diff(log.time)))
    if not SLOWEST <= rate <= FASTEST:
        likely = "ms taken for s" if rate < SLOWEST else "s taken for ms"
        raise InputError(
            f"{log.source}: samples are {rate:.3g} a second, where {SLOWEST:g} to {FASTEST:g} are expected: is the "
            f"unit of time right ({likely})?"
        )


def _prepared(piece: JointLog, moving: NDArray[np.bool_]) -> PreparedLog:
    rate = (len(piece) - 1) / float(piece.time[-1] - piece.time[0])
    return PreparedLog(piece.source, rate, piece.time, piece.position, piece.torque, moving)


def _pieces(log: JointLog) -> Iterator[JointLog]:
    """Pieces of a log between holes; those too short to be filtered are left out."""
    steps = np.diff(log.time)
    holes = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    ends = [0, *holes.tolist(), len(log)]
    found = [(a, b) for a, b in pairwise(ends) if b - a >= 50]
    if not found:
        raise InputError(f"{log.source}: no 50 samples follow each other without a hole in time")
    for a, b in found:
        velocity = None if log.velocity is None else log.velocity[a:b]
        yield JointLog(log.source, log.time[a:b], log.position[a:b], log.torque[a:b], velocity)


def _resampled(log: JointLog) -> tuple[JointLog, str]:
    """Even in time at the stamps' mean rate, by straight lines between samples, unless it is already."""
    steps = np.diff(log.time)
    even = np.linspace(log.time[0], log.time[-1], len(log))
    off = float(np.abs(log.time - even).max() * (len(log) - 1) / (log.time[-1] - log.time[0]))
    if off <= JITTER:
        return log, f"even at {1.0 / np.mean(steps):.6g} Hz"

    def lines(values: Array) -> Array:
        return np.stack([np.interp(even, log.time, column) for column in values.T], axis=-1)

    velocity = None if log.velocity is None else lines(log.velocity)
    how = f"stamps {steps.min():.3g} to {steps.max():.3g} s apart, resampled at {1.0 / np.mean(steps):.4g} Hz"
    return JointLog(log.source, even, lines(log.position), lines(log.torque), velocity), how


def _resampling(each: list[str], pieces: int) -> str:
    return f"{'; '.join(dict.fromkeys(each))}{f'; {pieces} pieces between holes' if pieces > 1 else ''}"


def _unwrapped(log: JointLog, mechanism: Mechanism) -> tuple[JointLog, int]:
    turns = np.array([joint.kind.is_revolute for joint in mechanism.primary_joints])
    continued = np.where(turns, np.unwrap(log.position, axis=0), log.position)
    offset = np.abs(np.diff(continued - log.position, axis=0)) > 1.0
    return replace(log, position=continued), int(offset.sum())


def _speed(log: JointLog) -> Array:
    """Velocities (n, r) through a filter of a twentieth of the rate, those at the ends repeated."""
    rate = (len(log) - 1) / float(log.time[-1] - log.time[0])
    kernel = derivative(low_pass(min(50.0, 0.1 * rate), rate), rate)
    inner = filtered(log.position, kernel) if len(kernel) < len(log) else np.gradient(log.position, 1 / rate, axis=0)
    around = len(log) - len(inner)
    return np.pad(inner, ((around // 2, around - around // 2), (0, 0)), mode="edge")


def _compared(source: str, logs: list[JointLog], speeds: list[Array], mechanism: Mechanism) -> str:
    """Logged velocities against differentiated positions, by regression through zero; of a joint at rest there are
    none to compare."""
    if any(log.velocity is None for log in logs):
        return "no logged velocities to compare with"
    logged = np.concatenate([log.velocity for log in logs if log.velocity is not None])
    found = np.concatenate(speeds)
    rests = (np.abs(found).max(axis=0) <= SLOW) & (np.abs(logged).max(axis=0) <= SLOW)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(rests, 1.0, (logged * found).sum(axis=0) / np.square(found).sum(axis=0))
    for joint, ratio in zip(mechanism.primary_joints, ratios.tolist(), strict=True):
        if not abs(ratio - 1.0) <= AGREEMENT:
            raise InputError(
                f"{source}: joint {joint.name!r}: logged velocities are {ratio:.4g} times the differentiated "
                f"positions{_explained(ratio)}; state the right units, or leave the velocities out"
            )
    return f"logged velocities are {ratios.min():.3f} to {ratios.max():.3f} of differentiated positions"


def _explained(ratio: float) -> str:
    likely = {
        57.29578: "velocities in deg/s, or positions in rad taken for deg",
        1.0 / 57.29578: "positions in deg taken for rad, or velocities in rad/s taken for deg/s",
        1000.0: "time in s taken for ms",
        0.001: "time in ms taken for s",
        1e6: "time in s taken for us",
        1e-6: "time in us taken for s",
        9.549297: "velocities in rpm",
        1.0 / 9.549297: "velocities in rad/s taken for rpm",
    }
    near = [text for value, text in likely.items() if abs(abs(ratio) / value - 1.0) < AGREEMENT]
    turned = "one of them has the wrong sign" if ratio < 0.0 else ""
    return "".join(f": {text}" for text in (near[:1] or [turned]) if text)


def _within_limits(source: str, logs: list[JointLog], speeds: list[Array], mechanism: Mechanism) -> str:
    """Speeds and positions against the robot's limits: wrong units and other robots show there."""
    fastest = np.percentile(np.abs(np.concatenate(speeds)), 99.0, axis=0)
    position = np.concatenate([log.position for log in logs])
    for j, joint in enumerate(mechanism.primary_joints):
        limits, low, high = joint.limits, float(position[:, j].min()), float(position[:, j].max())
        if fastest[j] > TOO_FAST * limits.velocity:
            raise InputError(
                f"{source}: joint {joint.name!r} moves at {fastest[j]:.3g} {joint.kind.position_unit}/s, its robot at "
                f"most at {limits.velocity:.3g}: are the positions in {'deg' if joint.kind.is_revolute else 'mm'}, "
                f"the time "
                "in ms, or is the gear ratio wrong?"
            )
        if low < limits.lower - TOO_FAR or high > limits.upper + TOO_FAR:
            raise InputError(
                f"{source}: joint {joint.name!r} goes from {low:.3g} to {high:.3g}, in its robot's file from "
                f"{limits.lower:.3g} to {limits.upper:.3g}: are units, gear ratio (and its sign) and offset right, and "
                "is it this robot's log?"
            )
        strongest = max(float(np.percentile(np.abs(log.torque[:, j]), 99.0)) for log in logs)
        if strongest > TOO_FAST * limits.effort:
            raise InputError(
                f"{source}: joint {joint.name!r} takes {strongest:.3g} {joint.kind.effort_unit}, its robot at most "
                f"{limits.effort:.3g}: are the unit of torque, the torque constant and the gear ratio right?"
            )
    return "positions, speeds and torques are within the robot's limits"


def _moving(logs: list[JointLog], speeds: list[Array]) -> list[NDArray[np.bool_]]:
    """Masks of motion, one a log: any joint is faster than a share of its greatest speed; rests shorter than AT_REST
    count as motion."""
    fastest = np.max([np.abs(v).max(axis=0) for v in speeds], axis=0)
    slow = np.maximum(REST * fastest, SLOW)
    return [_bridged((np.abs(v) > slow).any(axis=1), log.time) for log, v in zip(logs, speeds, strict=True)]


def _bridged(moving: NDArray[np.bool_], time: Array) -> NDArray[np.bool_]:
    out = moving.copy()
    edges = np.flatnonzero(np.diff(np.concatenate(([True], moving, [True])).astype(np.int8)))
    for start, end in edges.reshape(-1, 2).tolist():
        out[start:end] = time[min(end, len(time) - 1)] - time[start] < AT_REST
    return out
