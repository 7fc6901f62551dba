"""Assignment of a log's columns to joints, where no drives file states it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError, shown
from adaptctl.identification.column_names import column_name, joint_names
from adaptctl.identification.column_units import Units, each_joint, usual_units, validate_fitting
from adaptctl.identification.complete_rows import complete_rows
from adaptctl.identification.drives_content import MotorEntry
from adaptctl.identification.drives_file import Drives, locking
from adaptctl.identification.unknown_columns import validate_known, validate_numbers
from adaptctl.logs.on_disk import release, rowwise
from adaptctl.logs.table import LogTable
from adaptctl.logs.units import POSITION, TIME, TORQUE, VELOCITY, spaced

# Samples below which nothing can be learnt from a log.
MIN_SAMPLES = 100


@dataclass(frozen=True, eq=False)
class JointLog:
    """Log of r joints in SI units; for an unknown torque constant, torques are computed with the constant 1."""

    source: str
    time: Array
    position: Array
    torque: Array
    velocity: Array | None = None
    notes: tuple[str, ...] = ()
    """what was left out, joined or shifted"""

    def __len__(self) -> int:
        return len(self.time)


def joint_log(log: LogTable, drives: Drives, sample_rate: float | None = None) -> JointLog:
    """Log of joints from a table of its motors' columns."""
    _validate_there(log, ([] if sample_rate is not None else [drives.time]) + _used(drives))
    log = complete_rows(log, _used(drives), None if sample_rate is not None else drives.time)
    time = _time(log, drives, sample_rate)
    position = [log.column(m.position, f"position of {m.name}") for m in drives.motors]
    torque = [log.column(m.torque, f"torque of {m.name}") for m in drives.motors]
    if len(log) < MIN_SAMPLES:
        raise FileError(
            f"{log.source}: has {len(log)} samples; at least {MIN_SAMPLES} are needed, a few seconds of motion"
        )
    names = [f"{name}=VALUE" for name in drives.joints]
    still = [f"the joint is at rest throughout; if it is held, lock it: --lock {name}" for name in names]
    _validate_change(log, [m.position for m in drives.motors], position, still)
    _validate_change(log, [m.torque for m in drives.motors], torque, ["no torque was logged"] * len(names))
    _validate_differ(log, drives, position, torque)
    _validate_counted(log, drives, position)
    constants = np.nan_to_num(drives.constants, nan=1.0)
    return JointLog(
        log.source,
        time,
        _of_joints(lambda values: drives.position(values * drives.position_factors), position),
        _of_joints(lambda values: drives.torque(values * (drives.units.torque or 1.0) * constants), torque),
        _velocity(log, drives),
        tuple(f"{log.source}: {note}" for note in log.notes),
    )


def _validate_there(log: LogTable, names: list[str]) -> None:
    """Refuse a log without several of the columns, by all of their names."""
    if len(absent := [name for name in dict.fromkeys(names) if name not in log.columns]) > 1:
        raise FileError(f"{log.source}: no columns {', '.join(map(repr, absent))}; columns: {log.listed()}")


def _of_joints(compute: Callable[[Array], Array], columns: Sequence[Array]) -> Array:
    """Joints' values (n, r) of motors' columns (n,)."""
    return rowwise(lambda *rows: compute(np.stack(rows, axis=-1)), *columns)


def _used(drives: Drives) -> list[str]:
    """Names of the columns that are read besides time."""
    given = [name for motor in drives.motors for name in (motor.position, motor.torque)]
    return given + [
        motor.velocity for motor in drives.motors if motor.velocity and not np.isnan(drives.velocity_factors).any()
    ]


def _velocity(log: LogTable, drives: Drives) -> Array | None:
    names = [m.velocity for m in drives.motors]
    if np.isnan(drives.velocity_factors).any() or None in names:
        return None
    columns = [log.column(name, f"velocity of {m.name}") for m, name in zip(drives.motors, names, strict=True) if name]
    return _of_joints(lambda values: drives.velocity(values * drives.velocity_factors), columns)


def _time(log: LogTable, drives: Drives, rate: float | None) -> Array:
    if rate is not None:
        return rowwise(lambda number: number[:, None] / rate, np.arange(float(len(log))))[:, 0]
    own = log.units.get(drives.time, "")
    if TIME.get(own, drives.units.time) != drives.units.time:
        raise FileError(f"{log.source}: column {drives.time!r} is in {own}; leave out another unit of time")
    stamps = log.column(drives.time, "time")
    steps = np.diff(stamps)
    if len(steps) and steps.min() <= 0.0:
        row = int(np.argmax(steps <= 0.0))
        kind = "repeated" if steps[row] == 0.0 else "smaller than the previous one"
        raise FileError(
            f"{log.source}: column {drives.time!r}: the stamp {stamps[row + 1]:g} of row {row + 2} is {kind}; time "
            "must increase from row to row; remove repeated rows, sort them, or split the log"
        )
    if len(steps) and steps.min() == steps.max() == 1.0 and drives.units.time > 1e-3:
        raise FileError(
            f"{log.source}: column {drives.time!r} counts rows (0, 1, 2, ...) and is not a time; give the sampling "
            "rate with --sample-rate HZ"
        )
    return rowwise(lambda own: own[:, None] * drives.units.time, stamps)[:, 0]


def _jumps_by_turns(position: Array) -> bool:
    """True for positions (n,) in rad within one turn, which jump by it."""
    release()
    if not 1.8 * np.pi < np.ptp(position) <= 2.001 * np.pi:
        return False
    steps = np.abs(np.diff(position))
    return bool(steps.max() > 1.5 * np.pi and np.median(steps) < 0.25 * np.pi)


def _validate_counted(log: LogTable, drives: Drives, position: Sequence[Array]) -> None:
    """Refuse positions within one turn of a shaft that turns more often than its joint."""
    jumps = np.array([_jumps_by_turns(own * k) for own, k in zip(position, drives.position_factors, strict=True)])
    for i in np.flatnonzero(jumps & ((np.abs(drives.transmission) - np.eye(len(jumps))) != 0.0).any(axis=1)):
        motor, joint = drives.motors[i], drives.joints[i]
        raise FileError(
            f"{log.source}: column {motor.position!r} jumps by full turns, but motor {motor.name!r} turns "
            f"{drives.transmission[i, i]:g} times with joint {joint!r}: where it began is not known; give positions "
            "that count turns, or those of the joint"
        )


def _validate_change(log: LogTable, names: list[str], values: Sequence[Array], meanings: list[str]) -> None:
    for name, own, meaning in zip(names, values, meanings, strict=True):
        release()
        if np.ptp(own) == 0.0:
            raise FileError(
                f"{log.source}: column {name!r} is {log.columns[name][0]:g} in every row: {meaning}; or give "
                "another column or log"
            )


def _validate_differ(log: LogTable, drives: Drives, position: Sequence[Array], torque: Sequence[Array]) -> None:
    for motor, own, other in zip(drives.motors, position, torque, strict=True):
        if np.array_equal(own[:MIN_SAMPLES], other[:MIN_SAMPLES]) and np.array_equal(own, other):
            raise FileError(
                f"{log.source}: columns {motor.position!r} and {motor.torque!r} have the same numbers, but are "
                f"position and torque of {motor.name}; give another column or log"
            )


def same_place(first: str | Path, second: str | Path) -> bool:
    """True if two paths or their file names are equal."""
    return Path(first) == Path(second) or Path(first).name == Path(second).name


# Patterns of column names that are understood by themselves: of ROS messages, of our own runs, and usual ones.
KNOWN_PATTERNS = (
    {"position": "position.{joint}", "torque": "effort.{joint}", "velocity": "velocity.{joint}"},
    {"position": "p.{joint}", "torque": "applied.{joint}", "velocity": "v.{joint}"},
    {"position": "position.{joint}", "torque": "torque.{joint}", "velocity": "velocity.{joint}"},
    {"position": "{joint}.position", "torque": "{joint}.torque", "velocity": "{joint}.velocity"},
    {"position": "{joint}_position", "torque": "{joint}_torque", "velocity": "{joint}_velocity"},
)
FACTORS = {"time": TIME, "position": POSITION, "torque": TORQUE, "velocity": VELOCITY}
QUANTITIES = tuple(FACTORS)


def joint_columns(
    mechanism: Mechanism,
    log: LogTable,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    stamped: bool = True,
) -> Drives:
    """Drives of a robot whose joints are measured directly, by patterns of column names."""
    given, stated = _checked("columns", columns), _checked("units", units)
    joints = [joint.name for joint in mechanism.primary_joints]
    for what, text in given.items():
        validate_numbers(what, text, joints, log)
    pattern = _pattern(log, joints, given)
    found = {what: joint_names(names, joints, log, what) for what, names in pattern.items()}
    time = column_name(given.get("time", "time"), log)
    timed = {"time": [time], **found} if stamped or "time" in given else found
    symbols = ({} if stamped else {"time": "s"}) | _units(log, timed, stated)
    validate_known(log, joints, given, timed, symbols)
    each = {what: each_joint(what, symbol, joints) for what, symbol in symbols.items() if what != "time"}
    motors = tuple(
        MotorEntry(
            name=joint,
            position=found["position"][j],
            torque=found["torque"][j],
            velocity=found["velocity"][j] if "velocity" in found else None,
            position_unit=each["position"][j] if len(set(each["position"])) > 1 else None,
            velocity_unit=each["velocity"][j] if len(set(each.get("velocity", ()))) > 1 else None,
        )
        for j, joint in enumerate(joints)
    )
    r = len(joints)
    _validate_own(found, joints)
    turns = {joint.name: joint.kind.is_revolute for joint in mechanism.primary_joints}
    validate_fitting(each, turns, f"; or one for each: --units position={usual_units(turns)}")
    checked = _checked_units(log, symbols["time"], each)
    return Drives(tuple(joints), np.eye(r), np.zeros(r), motors, time, checked)


def _checked(what: str, given: Mapping[str, str] | None) -> dict[str, str]:
    if not isinstance(given, Mapping | None):
        raise InputError(f"{what}: expected a mapping such as {{'position': ...}}, got {shown(given)}")
    for name in given or {}:
        if name not in QUANTITIES:
            raise InputError(f"{what}: expected {', '.join(QUANTITIES)}, got {name!r}")
    for name, text in (given or {}).items():
        if not isinstance(text, str):
            raise InputError(f"{what}: {name}: expected a text, got {text!r}")
    return dict(given or {})


def _pattern(log: LogTable, joints: list[str], given: dict[str, str]) -> dict[str, str]:
    """Patterns as given, and those of usual names that the log has of all joints."""

    def has(pattern: str, what: str) -> bool:
        return all(name in log.columns for name in joint_names(pattern, joints, log, what))

    own = {name: text for name, text in given.items() if name != "time"}
    for known in KNOWN_PATTERNS:
        whole = known | own
        if has(whole["position"], "position") and has(whole["torque"], "torque"):
            return whole if "velocity" in given or has(whole["velocity"], "velocity") else _without_velocity(whole)
    if set(own) >= {"position", "torque"}:
        return own
    _validate_all_joints(log, joints, given)
    others = {what: text for known in KNOWN_PATTERNS for what, text in known.items() if has(text, what)}
    return own if set(own) & {"position", "torque"} else _without_velocity(others) | own


def _without_velocity(pattern: dict[str, str]) -> dict[str, str]:
    return {what: text for what, text in pattern.items() if what != "velocity"}


def _validate_all_joints(log: LogTable, joints: list[str], given: dict[str, str]) -> None:
    """Refuse a log that has the columns of some of the joints alone, and offer to lock the others."""
    for known in KNOWN_PATTERNS:
        whole = [(known | given)[what] for what in ("position", "torque")]
        if not all("{joint}" in pattern for pattern in whole):
            continue
        here = [j for j in joints if all(p.replace("{joint}", j) in log.columns for p in whole)]
        if here and len(here) < len(joints):
            others = [joint for joint in joints if joint not in here]
            raise FileError(
                f"{log.source}: no column {whole[0].replace('{joint}', others[0])!r} for position; the log has "
                f"{len(here)} of {len(joints)} joints{locking(others, here, joints)}"
            )


def _one_of(symbols: list[str], what: str, source: str) -> str:
    factors = {FACTORS[what].get(spaced(symbol), symbol) for symbol in symbols}
    if len(factors) > 1:
        more = f", or give one for each joint: --units {what}=..,.." if what in ("position", "velocity") else ""
        given = ", ".join(symbols)
        raise InputError(
            f"{source}: the columns of {what} have different units ({given}); convert them to SI units{more}"
        )
    return symbols[0]


def _validate_own(names: dict[str, list[str]], joints: list[str]) -> None:
    for what, columns in names.items():
        for j, name in enumerate(columns):
            if (i := columns.index(name)) < j:
                raise InputError(
                    f"columns: {what}: {name!r} is given for joint {joints[i]!r} and {joints[j]!r}; in a pattern "
                    "{joint} is the name of a joint, {} its number from 1, {0} from 0"
                )


def _units(log: LogTable, names: Mapping[str, list[str]], stated: dict[str, str]) -> dict[str, str]:
    """Units as stated, and those that the log states."""
    units = dict(stated)
    for what, columns in names.items():
        own = sorted({log.units.get(name, "") for name in columns})
        if what not in units and "" not in own:
            units[what] = _one_of(own, what, log.source)
    return units


def _checked_units(log: LogTable, time: str, each: Mapping[str, Sequence[str]]) -> Units:
    """Units of their symbols: those of the first joint, where all are known."""
    torque = _one_of(list(each["torque"]), "torque", log.source)
    pairs = zip(each["position"], _velocities(each), strict=True)
    checked, *_ = [Units.checked(time, position, torque, velocity) for position, velocity in pairs]
    if checked.torque is None:
        raise InputError(
            f"{log.source}: torques in {torque} need torque constants; give a drives file, which "
            "--template FILE writes, with torque_constant for every motor, or 'unknown'"
        )
    return checked


def _velocities(each: Mapping[str, Sequence[str]]) -> Sequence[str | None]:
    return each.get("velocity") or [None] * len(each["position"])
