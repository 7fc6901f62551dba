"""Logs made ready."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog
from adaptctl.identification.convolution import convolved, windowed_sinc
from adaptctl.identification.exchanged_columns import are_velocities, exchanged_words
from adaptctl.identification.late_stamps import are_even
from adaptctl.identification.logged_velocities import REST_SPEED, compared_velocities, whole_columns
from adaptctl.identification.position_faults import other_unit
from adaptctl.identification.rate_change import validate_one_rate
from adaptctl.logs.on_disk import each_column, of_columns, release, rowwise

# Length of a kernel, in periods of its cut-off.
KERNEL_PERIODS = 2.0
# Central difference of fourth order: a sine of a tenth of the rate loses 0.5 %.
DIFFERENCE = np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) / 12.0
DIFFERENCE_MARGIN = len(DIFFERENCE) // 2


def low_pass(cutoff: float, rate: float) -> Array:
    """Symmetric kernel (t,) that sums to 1 and halves a sine of `cutoff` Hz."""
    taps = 2 * round(0.5 * KERNEL_PERIODS * rate / cutoff) + 1
    return windowed_sinc(taps, cutoff, rate)


def padded(kernel: Array) -> Array:
    """Kernel with two zeros before and two after."""
    return np.pad(kernel, DIFFERENCE_MARGIN)


def derivative(kernel: Array, rate: float) -> Array:
    """Kernel (t + 4,) in 1/s of the time derivative of a filtered signal, by differences of fourth order."""
    return np.convolve(kernel, DIFFERENCE) * rate


def filtered(signal: ArrayLike, kernel: Array, every: int = 1) -> Array:
    """Convolution (m, ...) of a signal (n, ...) with a kernel, where that is wholly within it."""
    values = np.asarray(signal, dtype=np.float64)
    if len(values) < len(kernel):
        raise InputError(f"signal: expected at least {len(kernel)} samples, as the kernel has, got {len(values)}")
    flat = values.reshape(len(values), -1)
    whole = every == 1
    out = convolved(flat, kernel) if whole else _thinned(flat, kernel[::-1], every)
    return np.asarray(out).reshape(-1, *values.shape[1:])


def _thinned(values: Array, weights: Array, every: int) -> Array:
    """Sums (m, k) of weights (t,) times values (n, k), at every so manieth place, by products of matrices."""
    taps, width = len(weights), values.shape[1]
    count = -(-(len(values) - taps + 1) // every)
    shared = min(max(1, taps // every), count)  # rows of one product
    band = np.zeros((shared, taps + every * (shared - 1)))
    for i in range(shared):
        band[i, every * i : every * i + taps] = weights
    whole = count // shared
    stretches = sliding_window_view(values, band.shape[1], axis=0)[:: every * shared][:whole].swapaxes(1, 2)
    rest = sliding_window_view(values, taps, axis=0)[::every][whole * shared :]
    return np.concatenate([(band @ stretches).reshape(-1, width), rest @ weights])


# Shares of a sampling period: deviation of stamps that still count as even, and step that is a hole in the log.
MAX_JITTER, MIN_GAP_PERIODS = 0.01, 8.0
# A joint slower than this share of its greatest speed, or than a speed of rest, rests; when all do for so many s, the
# arm is at rest.
REST_SPEED_SHARE, MIN_REST_TIME = 0.01, 0.1
# Factor on the greatest speed, and excess in rad or m over the range, that a robot's file allows.
MAX_SPEED_RATIO, MAX_RANGE_EXCESS = 3.0, 0.25
# rad of a turn, and of a step beside jumps by full turns from which these cannot be told.
TURN, MAX_TURN_STEP = 2.0 * np.pi, 0.75 * np.pi
# Hz, between which logs of arms are sampled.
MIN_SAMPLE_RATE, MAX_SAMPLE_RATE = 20.0, 1e5
SKIPPED = "; or leave out this check by --skip-steps limits"
# Samples that are filtered at a time, of logs that have more.
SAMPLES_AT_ONCE = 2**17
# Names of the steps that can be skipped.
STEPS = ("resample", "unwrap", "velocities", "limits", "standstill")


class PreparationStep(NamedTuple):
    """Step of a log's preparation: its name and outcome in words."""

    name: str
    outcome: str


@dataclass(frozen=True, eq=False)
class PreparedLog:
    """Log at an even rate, with a mask of the samples at which the robot moves."""

    source: str
    rate: float
    time: Array
    position: Array
    torque: Array
    moving: NDArray[np.bool_]


def prepare(
    log: JointLog, mechanism: Mechanism, skip: Collection[str] = ()
) -> tuple[list[PreparedLog], list[PreparationStep]]:
    """Pieces of a log between holes in time, and the steps of their preparation."""
    _validate_known(skip)
    steps = [PreparationStep(name, "skipped") for name in STEPS if name in skip]
    pieces = list(_pieces(log))
    _validate_plausible_rate(log)
    if "unwrap" not in skip:
        turned = [_unwrapped(piece, mechanism) for piece in pieces]
        pieces = [piece for piece, _ in turned]
        steps.append(
            PreparationStep(
                "unwrap", f"{sum(count for _, count in turned)} jumps by full turns removed from the angles"
            )
        )
    if "resample" not in skip:
        done = [_resampled(piece) for piece in pieces]
        pieces = [piece for piece, _ in done]
        for piece in pieces:
            validate_one_rate(piece)
        steps.append(PreparationStep("resample", _resampling([how for _, how in done], len(pieces))))
    speeds = [_speed(piece) for piece in pieces]
    if "velocities" not in skip:
        steps.append(PreparationStep("velocities", compared_velocities(log.source, pieces, speeds, mechanism)))
    if "limits" not in skip:
        steps.append(PreparationStep("limits", _within_limits(log.source, pieces, speeds, mechanism)))
    moving = [np.ones(len(piece), dtype=np.bool_) for piece in pieces]
    if "standstill" not in skip:
        moving = _moving(pieces, speeds)
        share = float(np.mean(np.concatenate(moving)))
        if share * sum(len(piece) for piece in pieces) < 50:
            raise InputError(f"{log.source}: the arm is at rest throughout: the torques contain only gravity")
        steps.append(
            PreparationStep("standstill", f"{1.0 - share:.1%} of the samples removed, with the whole arm at rest")
        )
    return [_prepared(piece, where) for piece, where in zip(pieces, moving, strict=True)], steps


def _validate_known(skip: Collection[str]) -> None:
    if isinstance(skip, str):
        raise InputError(f"skip_steps: expected a list of names, got the text {skip!r}")
    if unknown := [name for name in skip if name not in STEPS]:
        raise InputError(f"skip_steps: expected {', '.join(STEPS)}, got {unknown[0]!r}")


def _validate_plausible_rate(log: JointLog) -> None:
    rate = 1.0 / float(np.median(np.diff(log.time)))
    if not MIN_SAMPLE_RATE <= rate <= MAX_SAMPLE_RATE:
        likely = "(ms taken for s), or record faster" if rate < MIN_SAMPLE_RATE else "(s taken for ms)"
        raise InputError(
            f"{log.source}: the sampling rate is {rate:.3g} Hz, but {MIN_SAMPLE_RATE:g} to {MAX_SAMPLE_RATE:g} Hz are "
            f"expected; check the unit of time {likely}"
        )


def _prepared(piece: JointLog, moving: NDArray[np.bool_]) -> PreparedLog:
    rate = (len(piece) - 1) / float(piece.time[-1] - piece.time[0])
    return PreparedLog(piece.source, rate, piece.time, piece.position, piece.torque, moving)


def _pieces(log: JointLog) -> Iterator[JointLog]:
    steps = np.diff(log.time)
    holes = np.flatnonzero(steps > MIN_GAP_PERIODS * np.median(steps)) + 1
    ends = [0, *holes.tolist(), len(log)]
    found = [(a, b) for a, b in pairwise(ends) if b - a >= 50]
    if not found:
        raise InputError(f"{log.source}: no 50 consecutive samples without a gap in time")
    for a, b in found:
        velocity = None if log.velocity is None else log.velocity[a:b]
        yield JointLog(log.source, log.time[a:b], log.position[a:b], log.torque[a:b], velocity)


def _resampled(log: JointLog) -> tuple[JointLog, str]:
    """Even in time at the stamps' mean rate, by straight lines between samples, unless it is already."""
    steps = np.diff(log.time)
    even = np.linspace(log.time[0], log.time[-1], len(log))
    off = float(np.abs(log.time - even).max() / np.mean(steps))
    if off <= MAX_JITTER:
        return log, f"even at {1.0 / np.mean(steps):.6g} Hz"
    if are_even(log.position, log.time, even):
        how = f"stamps {steps.min():.3g} to {steps.max():.3g} s apart, of samples that are even, as positions show"
        return replace(log, time=even), f"{how}: taken at {1.0 / np.mean(steps):.4g} Hz"

    def lines(values: Array) -> Array:
        return of_columns((np.interp(even, log.time, column) for column in each_column(values)), *values.shape)

    velocity = None if log.velocity is None else lines(log.velocity)
    how = f"stamps {steps.min():.3g} to {steps.max():.3g} s apart, resampled at {1.0 / np.mean(steps):.4g} Hz"
    return JointLog(log.source, even, lines(log.position), lines(log.torque), velocity), how


def _resampling(each: list[str], pieces: int) -> str:
    return f"{'; '.join(dict.fromkeys(each))}{f'; {pieces} segments between gaps' if pieces > 1 else ''}"


def _unwrapped(log: JointLog, mechanism: Mechanism) -> tuple[JointLog, int]:
    """Log with continuous angles within the robot's limits, and the number of jumps by full turns."""
    turns = np.array([joint.kind.is_revolute for joint in mechanism.primary_joints])
    logged = _ends(log.position)
    whole = bool(turns.any() and (logged[0, turns] >= 0.0).all() and (logged[1, turns] <= TURN).all())

    def continued() -> Iterator[Array]:
        return (unwrapped(own) if turn else own for own, turn in zip(each_column(log.position), turns, strict=True))

    pairs = zip(continued(), log.position.T, strict=True)
    jumps = [int((np.abs(np.diff(own - before)) > 1.0).sum()) for own, before in pairs]
    position = of_columns(continued(), *log.position.shape) if any(jumps) else log.position
    _validate_small_steps(log, position, [j for j, count in enumerate(jumps) if count], mechanism)
    wrapped = turns & (np.array(jumps, dtype=np.bool_) | whole)
    if mechanism.description.loops is None and wrapped.any():
        lower, upper = _ends(position)
        turned = np.where(wrapped, _turns_off(lower, upper, mechanism), 0.0)
        position = rowwise(lambda rows: rows + TURN * turned, position) if turned.any() else position
    return replace(log, position=position), sum(jumps)


def unwrapped(angles: Array) -> Array:
    """Angles (n,) without jumps by full turns; the same array where no step is of more than half a turn."""
    steps = np.diff(angles)
    return np.unwrap(angles) if max(steps.max(initial=0.0), -steps.min(initial=0.0)) > np.pi else angles


def _ends(values: Array) -> Array:
    """Least and greatest values (2, r) of columns."""
    return np.array([(own.min(), own.max()) for own in each_column(values)]).T


def whole_ends(parts: Sequence[Array]) -> Array:
    """Least and greatest values (2, r) of columns of parts that follow each other."""
    each = np.array([_ends(part) for part in parts])
    return np.stack([each[:, 0].min(axis=0), each[:, 1].max(axis=0)])


def _validate_small_steps(log: JointLog, position: Array, jumping: Sequence[int], mechanism: Mechanism) -> None:
    """Refuse jumps by full turns of some joints beside steps that may be of more than half a turn."""
    steps = ((j, np.abs(np.diff(position[:, j]))) for j in jumping)
    size, row, j = max(((own.max(), int(own.argmax()), j) for j, own in steps), default=(0.0, 0, 0))
    if size > MAX_TURN_STEP:
        name = mechanism.primary_joints[j].name
        raise InputError(
            f"{log.source}: joint {name!r} jumps by full turns, and at {log.time[row]:.6g} s by {size:.3g} rad "
            "besides, which may be more than half a turn: its turns cannot be told; record faster, log angles "
            f"that count turns, or leave out that row{other_unit(log.position[:, j])}"
        )


def _turns_off(least: Array, most: Array, mechanism: Mechanism) -> Array:
    """Full turns (r,) that bring angles, from the least to the greatest (r,), into the robot's limits."""
    lower, upper = (np.array([getattr(j.limits, end) for j in mechanism.primary_joints]) for end in ("lower", "upper"))
    turns = np.array([0.0, -1.0, 1.0, -2.0, 2.0])[:, None]
    beyond = np.maximum(lower - (least + TURN * turns), most + TURN * turns - upper)
    return np.asarray(turns[np.where(beyond[0] <= MAX_RANGE_EXCESS, 0, beyond.argmin(axis=0)), 0])


def _speed(log: JointLog) -> Array:
    rate = (len(log) - 1) / float(log.time[-1] - log.time[0])
    kernel = derivative(low_pass(min(50.0, 0.1 * rate), rate), rate)

    def speed(position: Array) -> Array:
        short = len(kernel) >= len(log)
        inner = np.gradient(position, 1 / rate) if short else _filtered_in_parts(position, kernel)
        around = len(log) - len(inner)
        return np.pad(inner, (around // 2, around - around // 2), mode="edge")

    return of_columns(map(speed, each_column(log.position)), *log.position.shape)


def _filtered_in_parts(column: Array, kernel: Array) -> Array:
    """Convolution (m,) of a column with a kernel, where that is wholly within it."""
    inner = len(column) - len(kernel) + 1
    ends = (min(start + SAMPLES_AT_ONCE, inner) for start in range(0, inner, SAMPLES_AT_ONCE))
    starts = range(0, inner, SAMPLES_AT_ONCE)
    parts = [filtered(column[a : b + len(kernel) - 1], kernel) for a, b in zip(starts, ends, strict=True)]
    return np.concatenate(parts)


def _within_limits(source: str, logs: list[JointLog], speeds: list[Array], mechanism: Mechanism) -> str:
    """Speeds and positions against the robot's limits: wrong units and other robots show there."""
    fastest = [np.percentile(np.abs(own), 99.0) for own in whole_columns(speeds)]
    lower, upper = whole_ends([log.position for log in logs])
    for j, joint in enumerate(mechanism.primary_joints):
        limits, low, high, trouble = joint.limits, float(lower[j]), float(upper[j]), ""
        release()
        strongest = max(float(np.percentile(np.abs(log.torque[:, j]), 99.0)) for log in logs)
        if fastest[j] > MAX_SPEED_RATIO * limits.velocity:
            unit = "deg" if joint.kind.is_revolute else "mm"
            cause = f"check the gear ratio, and whether positions are in {unit} or times in ms"
            if are_velocities([(log.time, log.position) for log in logs], mechanism.primary_joints):
                cause = f"are positions velocities, as which all joints' are within the limits? Else {cause}"
            trouble = (
                f"moves at {fastest[j]:.3g} {joint.kind.position_unit}/s, but the limit of the robot is "
                f"{limits.velocity:.3g}; {cause}"
            )
        elif low < limits.lower - MAX_RANGE_EXCESS or high > limits.upper + MAX_RANGE_EXCESS:
            trouble = (
                f"moves from {low:.3g} to {high:.3g}, but the limits of the robot file are {limits.lower:.3g} to "
                f"{limits.upper:.3g}; {_fitting(lower, upper, mechanism, j)}check units, gear ratio (and its sign) and "
                "offset, and that the log is this robot's"
            )
        elif strongest > MAX_SPEED_RATIO * limits.effort:
            trouble = (
                f"has a torque of {strongest:.3g} {joint.kind.effort_unit}, but the limit of the robot is "
                f"{limits.effort:.3g}; check the unit of torque, the torque constant and the gear ratio"
            )
        if trouble:
            trouble += exchanged_words([(log.position, log.torque) for log in logs])
            raise InputError(f"{source}: joint {joint.name!r} {trouble}{SKIPPED}")
    return "positions, velocities and torques are within the limits of the robot"


def _fitting(least: Array, most: Array, mechanism: Mechanism, j: int) -> str:
    """Words on the sign and the exchanges of a joint's positions that are within the limits, by all joints' ends."""
    joints = mechanism.primary_joints

    def fits(low: float, high: float, k: int) -> bool:
        limits = joints[k].limits
        return bool(limits.lower - MAX_RANGE_EXCESS <= low and high <= limits.upper + MAX_RANGE_EXCESS)

    found = ["of the other sign"] if fits(-most[j], -least[j], j) else []
    found += [
        f"exchanged with those of {joint.name!r}"
        for k, joint in enumerate(joints)
        if k != j and fits(least[k], most[k], j) and fits(least[j], most[j], k)
    ]
    return f"{', or '.join(found)} they would be within; " if found else ""


def _moving(logs: list[JointLog], speeds: list[Array]) -> list[NDArray[np.bool_]]:
    """Masks of motion: any joint is faster than a share of its greatest speed."""
    fastest = np.abs(whole_ends(speeds)).max(axis=0)
    slow = np.maximum(REST_SPEED_SHARE * fastest, REST_SPEED)
    return [_bridged(_any_above(v, slow), log.time) for log, v in zip(logs, speeds, strict=True)]


def _any_above(values: Array, least: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the rows of an array (n, r) in which a column is above its least number, whatever the sign."""
    each = zip(each_column(values), least, strict=True)
    return reduce(np.logical_or, (np.abs(own) > size for own, size in each))


def _bridged(moving: NDArray[np.bool_], time: Array) -> NDArray[np.bool_]:
    out = moving.copy()
    edges = np.flatnonzero(np.diff(np.concatenate(([True], moving, [True])).astype(np.int8)))
    for start, end in edges.reshape(-1, 2).tolist():
        out[start:end] = time[min(end, len(time) - 1)] - time[start] < MIN_REST_TIME
    return out
