"""Checks of a log before any fit: rows that no joint can do, and columns that are clipped, frozen or dead."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description.joint import Joint
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import position_unit
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog
from adaptctl.identification.convolution import median_of_five
from adaptctl.identification.position_faults import (
    COMPARED,
    equal_columns,
    frozen_position,
    odd_stamps,
    slip_words,
    slips,
)
from adaptctl.identification.preparation import MIN_GAP_PERIODS, PreparationStep, unwrapped, whole_ends
from adaptctl.logs.on_disk import each_column, of_columns, one_by_one, release
from adaptctl.stages import stage

# Step over the 99th percentile of a column's steps, and in rad (m), from where on no joint does it; samples after which
# it is back, or is no outlier.
JUMP_RATIO, LEAST_JUMP, LONGEST_RUN = 8.0, 0.01, 20
# Torque off the median of five over the range of 98 % of the torques, and over the median of such differences.
SPIKE_SHARE, SPIKE_RATIO = 0.5, 12.0
# Samples at the greatest torque over those at any of the next values, and least share of them in the log.
CLIPPED_RATIO, CLIPPED_SHARE, NEXT_VALUES = 6.0, 2e-3, 5
# Seconds and samples of one torque, and times the usual run of one and the fifth longest, from where on it is frozen.
FROZEN_TIME, FROZEN_SAMPLES, FROZEN_RATIO, FEWER_RATIO = 0.1, 20, 10.0, 4.0
# Shares of a torque's maximum, below and above which it is clear whether it is at 0, and times that it falls to 0 and
# keeps its sign from which on that was taken off.
NEAR_ZERO, FROM_ZERO, FALLS = 0.03, 0.15, 5
FILLED = "; filled from their neighbours"
# Samples by which stretches of several joints differ that froze at once.
AT_ONCE = 2
# Range of torques over the largest of a robot's, below which it is dead, and share of rows with a value of their own
# from where on a column's quantum is below its noise, of so many rows.
DEAD_SHARE, OWN_VALUES, MANY_VALUES = 3e-4, 0.5, 250_000


@stage("checking logs")
def checked_log(log: JointLog, mechanism: Mechanism) -> tuple[JointLog, list[PreparationStep]]:
    """Log whose impossible rows are filled from their neighbours, with notes on its faults, and facts about it."""
    joints, turns = mechanism.primary_joints, [joint.kind.is_revolute for joint in mechanism.primary_joints]
    position, torque = list(log.position.T), list(log.torque.T)
    velocity = None if log.velocity is None else list(log.velocity.T)
    filled: list[list[str]] = []
    periods = np.diff(log.time)
    periods = np.maximum(periods / np.median(periods), 1.0)
    for j, joint in enumerate(joints):
        wrong, whole = _impossible(unwrapped(position[j]) if turns[j] else position[j], periods)
        if wrong.any():
            position[j] = np.where(wrong, _filled(log.time, whole, wrong), position[j])
            if velocity is not None:
                velocity[j] = _filled(log.time, velocity[j], wrong)
        release()
        spiked = _spiked(torque[j])
        torque[j] = _filled(log.time, torque[j], spiked)
        release()
        words = _filled_words(log, joint, "positions that it cannot reach", wrong)
        words += slip_words(log.time, whole, slips(whole, periods, wrong), joint)
        words += frozen_position(log.time, whole, joint)
        filled.append(words + _filled_words(log, joint, "torques that stand out of their neighbours", spiked))
    dead = _dead(position, torque)
    faults = list(_column_faults(position, torque, dead, joints))
    notes = [note for pair in zip(filled, faults, strict=True) for own in pair for note in own]
    notes += _frozen_words(log.time, position, torque, dead, joints)
    notes += _absolute_words(torque, joints)
    notes += equal_columns("positions", position, joints)
    notes += equal_columns("torques", torque, joints)
    first = [own[:COMPARED] for own in position]
    turned = [unwrapped(own) if turn else own for own, turn in zip(first, turns, strict=True)]
    notes += odd_stamps(log.time[:COMPARED], np.column_stack(turned))
    said = (*log.notes, *(f"{log.source}: {note}" for note in notes))
    rates = None if log.velocity is None or velocity is None else _of_columns(velocity, log.velocity)
    positions, torques = _of_columns(position, log.position), _of_columns(torque, log.torque)
    checked = replace(log, position=positions, torque=torques, velocity=rates, notes=said)
    return checked, list(_facts(checked, mechanism))


def _of_columns(columns: Sequence[Array], before: Array) -> Array:
    """Array (n, r) of columns; that from before where all are its own."""
    unchanged = all(np.shares_memory(own, column) for own, column in zip(columns, before.T, strict=True))
    return before if unchanged else of_columns(columns, *before.shape)


def found_faults(logs: Sequence[JointLog], checked: Sequence[JointLog]) -> list[str]:
    """Sentences on the faults that the checks of logs have found and not mended."""
    each = (note for log, own in zip(logs, checked, strict=True) for note in own.notes[len(log.notes) :])
    return [note for note in each if not note.endswith(FILLED)]


@contextmanager
def told_first(faults: Sequence[str]) -> Iterator[None]:
    """Let a refusal begin with the faults that were found before, as these lead to it."""
    try:
        yield
    except InputError as error:
        if not faults:
            raise
        raise InputError("; ".join([*faults, str(error)])) from error


def still_joints(logs: Sequence[JointLog], mechanism: Mechanism) -> list[str]:
    """Names of the joints that stand still in all logs; `InputError` where all do."""
    least, most = whole_ends([log.position for log in logs])
    moved = most - least
    if moved.max() < LEAST_JUMP:
        raise InputError(
            f"{logs[0].source}: no joint moves by {LEAST_JUMP:g} rad (m) or more; check the unit of positions, and log "
            "a motion of all joints"
        )
    return [joint.name for joint, way in zip(mechanism.primary_joints, moved, strict=True) if way < LEAST_JUMP]


def unmeasured(logs: Sequence[JointLog], mechanism: Mechanism) -> list[str]:
    """Remedies for joints that move while their torques are dead, or their positions frozen, in any log."""
    dead = np.any([_dead(log.position.T, log.torque.T) for log in logs], axis=0)
    frozen = np.any([list(_are_frozen(log, mechanism.primary_joints)) for log in logs], axis=0)
    each = (("record the torque of", dead), ("cut the stretches out of the log that freeze", frozen))
    names = np.array([joint.name for joint in mechanism.primary_joints])
    return [f"{what} {', '.join(names[own].tolist())}" for what, own in each if own.any()]


def _are_frozen(log: JointLog, joints: Sequence[Joint]) -> Iterator[bool]:
    for own, joint in zip(each_column(log.position), joints, strict=True):
        yield any(frozen_position(log.time, own, joint))


def _dead(position: Iterable[Array], torque: Iterable[Array]) -> NDArray[np.bool_]:
    """Mask (r,) of the joints that move while their torques hardly change."""
    widths, ranges = (np.array([np.ptp(own) for own in one_by_one(columns)]) for columns in (position, torque))
    return np.asarray((widths > LEAST_JUMP) & (ranges < DEAD_SHARE * ranges.max()))


def still_words(still: Sequence[str]) -> Iterator[str]:
    """Sentences on joints that stand still in all logs."""
    for name in still:
        yield (
            f"{name} stands still: its friction and rotor inertia stay open, as in the robot file or without, and so "
            "does what its motion alone shows of the links; log a motion of it, or set them in the written robot"
        )


def _filled_words(log: JointLog, joint: Joint, what: str, wrong: NDArray[np.bool_]) -> list[str]:
    count = int(wrong.sum())
    row = int(np.argmax(wrong))
    where = f"the first in row {row + 1}, at {log.time[row]:.6g} s"
    return [f"joint {joint.name!r} has {count} {what}, {where}{FILLED}"] if count else []


def _impossible(values: Array, periods: Array | float = 1.0) -> tuple[NDArray[np.bool_], Array]:
    """Mask (n,) of the short runs that a column jumps to and back from, and the column; steps are those of a period."""
    steps = np.diff(values)
    np.abs(steps, out=steps)
    steps /= periods
    most = max(JUMP_RATIO * float(np.percentile(steps, 99.0)), LEAST_JUMP)
    jumps, wrong = np.flatnonzero(steps > most) + 1, np.zeros(len(values), dtype=np.bool_)
    for start in jumps.tolist():
        if wrong[start] or wrong[start - 1]:
            continue
        after = values[start + 1 : start + 1 + LONGEST_RUN]
        back = np.abs(after - values[start - 1]) <= most * 0.5 * np.arange(2, len(after) + 2)
        back &= np.abs(np.diff(values[start : start + 1 + len(after)])) > 0.5 * most  # at once, as it went
        if back.any():
            wrong[start : start + 1 + int(np.argmax(back))] = True
    return wrong, values


def _filled(time: Array, values: Array, wrong: NDArray[np.bool_]) -> Array:
    if not wrong.any() or np.count_nonzero(~wrong) < 4:
        return values
    from scipy.interpolate import CubicSpline  # loaded only where there are faults

    return np.where(wrong, CubicSpline(time[~wrong], values[~wrong])(time), values)


def _spiked(torque: Array) -> NDArray[np.bool_]:
    """Mask (n,) of single torques that are far from those around them."""
    off = torque - median_of_five(torque)
    np.abs(off, out=off)
    low, high = np.percentile(torque, [1.0, 99.0])
    return np.asarray(off > max(SPIKE_SHARE * (high - low), SPIKE_RATIO * float(np.median(off)), 1e-12))


def _column_faults(
    position: Sequence[Array], torque: Sequence[Array], dead: NDArray[np.bool_], joints: Sequence[Joint]
) -> Iterator[list[str]]:
    """Sentences on each joint's torque that is clipped or dead."""
    any_moved = _moved(position)
    for j, joint in enumerate(joints):
        release()
        own, unit = torque[j], joint.kind.effort_unit
        if dead[j]:
            held = f"{own.mean():.3g} {unit} to within {np.ptp(own):.2g}"
            yield [f"the torque of joint {joint.name!r} is {held}: its sensor seems dead"]
        else:
            yield list(_clipped_words(own[any_moved], joint))


def _moved(position: Sequence[Array]) -> NDArray[np.bool_]:
    """Mask (n,) of the rows in which any position is not that of the row before."""
    changed = np.zeros(len(position[0]), dtype=np.bool_)
    for own in position:
        changed[1:] |= own[1:] != own[:-1]
        release()
    return changed


def _clipped_words(torque: Array, joint: Joint) -> Iterator[str]:
    for value, count in _clipped(torque):
        yield (
            f"the torque of joint {joint.name!r} is clipped: {count} rows have exactly {value:.4g} "
            f"{joint.kind.effort_unit}; record a gentler motion, or leave these rows out"
        )


def validate_signed(logs: Sequence[JointLog], mechanism: Mechanism) -> None:
    """Raise `InputError` for a log of which several joints' torques are absolute values."""
    for log in logs:
        if len(_absolute(each_column(log.torque), mechanism.primary_joints)) > 1:
            raise InputError("torques without signs tell no links; --trust-log takes them as they are")


def _absolute(torque: Iterable[Array], joints: Sequence[Joint]) -> dict[str, int]:
    """Numbers of times, by joints' names, that torques which are never negative fall to nearly 0, if often."""
    falls = {joint.name: _falls(own) for own, joint in zip(torque, joints, strict=True)}
    return {name: count for name, count in falls.items() if count >= FALLS}


def _absolute_words(torque: Sequence[Array], joints: Sequence[Joint]) -> Iterator[str]:
    """Sentence on torques that are absolute values."""
    if found := [f"{name!r} ({count} times)" for name, count in _absolute(torque, joints).items()]:
        yield (
            f"torques fall to 0 and are never negative, of joints {', '.join(found)}: are they absolute values? Record "
            "them with their signs"
        )


def _falls(torque: Array) -> int:
    """Number of times that a torque falls to 0; none if it is ever negative."""
    release()
    most = float(torque.max())
    if torque.min() < 0.0:
        return 0
    clear = torque[(torque < NEAR_ZERO * most) | (torque > FROM_ZERO * most)]
    return int(np.count_nonzero(np.diff((clear > NEAR_ZERO * most).astype(np.int8)) < 0))


def _frozen_words(
    time: Array, position: Sequence[Array], torque: Sequence[Array], dead: NDArray[np.bool_], joints: Sequence[Joint]
) -> Iterator[str]:
    """Sentences on stretches of frozen torques, one for all joints that freeze at once."""
    found: dict[tuple[int, int], list[tuple[int, float]]] = {}
    for j in np.flatnonzero(~dead).tolist():
        start, end = _frozen(torque[j], position[j], time)
        release()
        at = next((own for own in found if max(abs(own[0] - start), abs(own[1] - end)) <= AT_ONCE), (start, end))
        if end > start:
            found.setdefault(at, []).append((j, float(torque[j][start])))
    for (start, end), own in found.items():
        names = ", ".join(repr(joints[j].name) for j, _ in own)
        values = ", ".join(f"{value:.4g} {joints[j].kind.effort_unit}" for j, value in own)
        what = f"the torques of joints {names} are" if len(own) > 1 else f"the torque of joint {names} is"
        ends = f"from {time[start]:.6g} to {time[end - 1]:.6g} s"
        yield f"{what} frozen at {values} {ends}; cut this stretch out of the log"


def _clipped(torque: Array) -> Iterator[tuple[float, int]]:
    """Greatest and least torques that far more rows have than any of the next values, and their counts."""
    least = max(10.0, CLIPPED_SHARE * len(torque))
    if not len(torque) or max(np.count_nonzero(torque == end) for end in (torque.max(), torque.min())) < least:
        return  # which is known sooner than the values are sorted
    values, counts = np.unique(torque, return_counts=True)
    for each, own in ((values[::-1], counts[::-1]), (values, counts)):
        if len(each) > NEXT_VALUES and own[0] >= max(least, CLIPPED_RATIO * own[1 : 1 + NEXT_VALUES].max()):
            yield float(each[0]), int(own[0])


def _frozen(torque: Array, position: Array, time: Array) -> tuple[int, int]:
    """Longest run (start, end) of one torque while the joint moves; (0, 0) if it is no longer than usual."""
    edges = np.concatenate([[0], np.flatnonzero(torque[1:] != torque[:-1]) + 1, [len(torque)]])
    lengths = np.diff(edges)
    at = int(np.argmax(lengths))
    if lengths[at] < FROZEN_SAMPLES:
        return 0, 0
    start, end = int(edges[at]), int(edges[at + 1])
    usual = float(np.percentile(lengths, 95.0))
    others = FEWER_RATIO * float(np.sort(lengths)[-min(5, len(lengths))])
    extremes = torque[start] in (torque.max(), torque.min())
    long = (
        lengths[at] >= max(FROZEN_SAMPLES, FROZEN_RATIO * usual, others) and time[end - 1] - time[start] >= FROZEN_TIME
    )
    moves = np.count_nonzero(np.diff(position[max(start - 1, 0) : end])) > 0.5 * (end - start)
    return (start, end) if long and not extremes and moves else (0, 0)


def _facts(log: JointLog, mechanism: Mechanism) -> Iterator[PreparationStep]:
    """Lines on rows and rates, on quanta, and on joints that stand still."""
    steps = np.diff(log.time)
    gaps = steps[steps > MIN_GAP_PERIODS * np.median(steps)]
    held = f"; {len(gaps)} gaps, the longest of {gaps.max():.3g} s" if len(gaps) else ""
    rate = 1.0 / float(np.median(steps))
    of = f"of {Path(log.source).name}"
    yield PreparationStep(
        f"rows {of}",
        f"{len(log)} rows of {np.ptp(log.time):.4g} s at {rate:.4g} Hz, at most {steps.max():.3g} s apart{held}",
    )
    names = [joint.name for joint in mechanism.primary_joints]
    quanta = [_quantum(column) for column in each_column(log.position)]
    each = ", ".join(f"{name} {q:.2g}" for name, q in zip(names, quanta, strict=True) if q)
    yield PreparationStep(
        f"quanta of positions {of}", f"{each} {position_unit(mechanism)}" if each else "below the noise"
    )
    still = [n for n, column in zip(names, each_column(log.position), strict=True) if np.ptp(column) < LEAST_JUMP]
    yield PreparationStep(f"still joints {of}", ", ".join(still) or "none")


def _quantum(values: Array) -> float:
    """Distance of neighbouring values of a column, 0 if nearly every row has its own; by some of very many rows."""
    some = values[:: -(-len(values) // MANY_VALUES)]
    own = np.unique(some)
    return float(np.median(np.diff(own))) if 1 < len(own) < OWN_VALUES * len(some) else 0.0
