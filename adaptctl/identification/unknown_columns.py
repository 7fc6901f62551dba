"""Refusals of columns and units that are not known, each with all that is missing and the flags that state it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import count, takewhile
from shlex import split

import numpy as np

from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.column_names import (
    CURRENTS,
    NAMES,
    UNIT_TO_GIVE,
    as_word,
    joint_names,
    likely_pair,
    likely_time,
    offer,
    words_of,
)
from adaptctl.identification.column_units import validate_fitting
from adaptctl.identification.drives_file import Drives
from adaptctl.logs.table import LogTable

MARKS = "({}: number of the joint from 1, {0}: from 0, {joint}: its name)"
NAMED_UNITS = {
    **{unit: unit for unit in ("ms", "us", "ns", "deg", "rpm", "rad", "mm")},
    **{"degrees": "deg", "grad": "deg", "nm": "N m", "mnm": "mN m", "ma": "mA", "amp": "A", "amps": "A"},
}
"""units that the last word of a column's name may be"""
SI = {"time": "s", "position": "rad", "torque": "N m", "velocity": "rad/s"}
MANY, TURN_AND_HALF = 30, 9.5
"""columns that are listed, and rad that few joints go beyond"""
RATE = "the rate of even rows: --sample-rate HZ"
DRIVES = "or give a drives file, which --template FILE writes"


def validate_numbers(what: str, pattern: str, joints: list[str], log: LogTable) -> None:
    """Refuse a pattern with numbers of joints that has more columns than the robot has joints."""
    for mark, first in (("{}", 1), ("{0}", 0)):
        if mark not in pattern:
            continue
        names = (pattern.replace(mark, str(k)) for k in count(first))
        found = list(takewhile(lambda name: name in log.columns, names))
        if len(found) > len(joints):
            unused = ", ".join(found[len(joints) :])
            raise InputError(
                f"{log.source}: {what}={pattern} has {len(found)} columns, but the robot {len(joints)} joints "
                f"({', '.join(joints)}): {unused} would be unused; give the robot of this log, or name the columns of "
                f"its joints: --columns {as_word(what + '=' + ','.join(found[: len(joints)]))}"
            )


def validate_known(
    log: LogTable,
    joints: list[str],
    given: Mapping[str, str],
    named: Mapping[str, list[str]],
    symbols: Mapping[str, str],
) -> None:
    """Raise `InputError` where columns or units are unknown: one for all, with the flags that would state them."""
    absent = {what: missing for what, names in named.items() if (missing := [n for n in names if n not in log.columns])}
    unknown = [what for what in ("position", "torque") if what not in named]
    unitless = [what for what in SI if what in (*named, *unknown) and what not in symbols]
    if unknown and log.numbered:
        lacking = f"has no line of column names, and {len(log.columns)} columns; give their numbers"
        raise InputError(f"{log.source}: {lacking}, {offer(log, len(joints))}")
    wrong = [what for what in absent if what in given]
    found = [(_absent(absent[what][0], what, log), "") for what in wrong]
    if unknown:
        problem = f"the columns of each joint's {' and '.join(unknown)} are unknown"
        found.append((problem, _columns_remedy(log, joints, unknown)))
    if "time" in absent and "time" not in given:
        found.append(("no column 'time' for the time", f"specify it: --columns {likely_time(log)}, or {RATE}"))
    if unitless:
        remedy = f"give {_units_flag(log, {what: named.get(what, []) for what in unitless})}, or others"
        found.append((f"the units of {', '.join(unitless)} are unknown", remedy))
    if len(found) == 1 and wrong:
        log.column(absent[wrong[0]][0], wrong[0])
    if len(found) == 1:
        raise InputError(f"{log.source}: {'; '.join(found[0])}")
    if found:
        flags = _all_flags(log, joints, given, named, symbols, [*absent, *unknown])
        raise InputError(
            f"{log.source}: {'; '.join(problem for problem, _ in found)}; as far as names tell: {flags} "
            f"{_marks(flags)}, {DRIVES}; {_there(log, joints)}"
        )


def _absent(name: str, what: str, log: LogTable) -> str:
    near = log.near(name)
    return f"no column {name!r} for {what}{f' ({near}?)' if near else ''}"


def _there(log: LogTable, joints: list[str]) -> str:
    """Names of joints and of columns."""
    return f"joints: {', '.join(joints)}; columns: {log.listed(MANY)}"


def _columns_remedy(log: LogTable, joints: list[str], unknown: list[str]) -> str:
    pairs = " ".join(likely_pair(what, joints, log) for what in unknown)
    return f"specify them with --columns, such as {pairs} {_marks(pairs)}, {DRIVES}; {_there(log, joints)}"


def _marks(text: str) -> str:
    """Words on what stands for the joints in a text, and on columns that no name tells."""
    kinds = [what for what in ("position", "torque") if f"{what}={NAMES}" in text]
    told = f"(no names are recognised as {' or '.join(kinds)}: in place of {NAMES}, one for each joint, with commas; "
    return MARKS.replace("(", told, 1) if kinds else MARKS


def _all_flags(
    log: LogTable,
    joints: list[str],
    given: Mapping[str, str],
    named: Mapping[str, list[str]],
    symbols: Mapping[str, str],
    lacking: Sequence[str],
) -> str:
    """Flags with what was given and is there, and what is likely for the rest."""
    pairs = {what: as_word(f"{what}={text}") for what, text in given.items() if what not in lacking}
    if "time" in lacking:
        pairs["time"] = likely_time(log)
    pairs |= {what: likely_pair(what, joints, log) for what in ("position", "torque") if what in lacking}
    columns = {what: [split(pair)[0].partition("=")[2]] for what, pair in pairs.items()}
    columns |= {what: names for what, names in named.items() if what not in lacking}
    told = {what: joint_names(names[0], joints, log) if "{" in names[0] else names for what, names in columns.items()}
    ordered = " ".join(pairs[what] for what in SI if what in pairs)
    return f"--columns {ordered} {_units_flag(log, told, symbols)}" if pairs else _units_flag(log, told, symbols)


def _units_flag(log: LogTable, named: Mapping[str, list[str]], symbols: Mapping[str, str] | None = None) -> str:
    """Units that were stated, and likely ones."""
    units = {what: (symbols or {}).get(what) or _likely_units(what, names, log) for what, names in named.items()}
    return f"--units {' '.join(as_word(f'{what}={units[what]}') for what in SI if what in units)}"


def _likely_units(what: str, names: list[str], log: LogTable) -> str:
    """Unit of the columns of all joints, or a list of each."""
    each = [named_unit(what, name) for name in names if name in log.columns]
    is_list = what in ("position", "velocity") and len(set(each)) > 1 and "" not in each
    return ",".join(each) if is_list else likely_unit(what, names, log)


def named_unit(what: str, name: str) -> str:
    """Unit that a column's name ends with, else nothing."""
    last = re.split(r"[\W_]+", name.rstrip("])"))[-1]
    return "A" if what == "torque" and last == "A" else NAMED_UNITS.get(last.lower(), "")


def likely_unit(what: str, names: list[str], log: LogTable) -> str:
    """Unit that a column's name ends with, else by the size of its numbers, else that of SI; none of no column."""
    name = names[0] if names else ""
    if what != "time" and name not in log.columns:
        return UNIT_TO_GIVE
    if own := named_unit(what, name):
        return own
    if what == "torque" and any(word in CURRENTS for word in words_of(name)):
        return "A"
    values = log.columns.get(name)
    if values is None or not np.isfinite(values).all() or len(values) < 2:
        return SI[what]
    if what == "time":
        step = abs(float(np.median(np.diff(values))))
        return next((unit for unit, least in (("ns", 1e5), ("us", 100.0), ("ms", 0.1)) if step > least), "s")
    return "deg" if what == "position" and np.abs(values).max() > TURN_AND_HALF else SI[what]


def validate_drives(log: LogTable, drives: Drives, mechanism: Mechanism) -> None:
    """Raise `InputError` where drives fit neither the robot nor the log: both in one line."""
    given = [name for motor in drives.motors for name in (motor.position, motor.torque)]
    absent = [name for name in dict.fromkeys(given) if name not in log.columns]
    try:
        _validate_units(drives.ordered_like(mechanism), mechanism)
    except InputError as error:
        if not absent:
            raise
        told = f"{log.source}: no columns {', '.join(map(repr, absent))}; columns: {log.listed(MANY)}"
        raise InputError(f"{error}; {told}") from error


def _validate_units(drives: Drives, mechanism: Mechanism) -> None:
    """Refuse units of a motor's position that its joint cannot have; those behind gears may have any."""
    joints = mechanism.primary_joints
    direct = [i for i, ratio in enumerate(np.diag(drives.transmission)) if abs(ratio) == 1.0]
    turns = {joints[i].name: joints[i].kind.is_revolute for i in direct}
    remedy = "; give each motor its own position_unit and velocity_unit, or its ratio in transmission"
    for what in ("position", "velocity"):
        symbols = [getattr(drives.motors[i], f"{what}_unit") for i in direct]
        if None not in symbols:
            validate_fitting({what: symbols}, turns, remedy)


def unused_joints(log: LogTable, drives: Drives, mechanism: Mechanism) -> list[str]:
    """Words on joints that a log has columns of, and the robot has not; none where columns have no joints' names."""
    motor, joint = drives.motors[0], drives.joints[0]
    if joint not in motor.position or joint not in motor.torque:
        return []
    names = [re.escape(name).replace(re.escape(joint), "(.+)", 1) for name in (motor.position, motor.torque)]
    found = [{own[1]: None for column in log.columns if (own := re.fullmatch(name, column))} for name in names]
    known = {link.joint.name for link in mechanism.description.links} | set(mechanism.description.locked)
    others = [name for name in found[0] if name in found[1] and name not in known]
    told = f"columns of {', '.join(others)} are unused: {mechanism.name} has no such joints"
    return [told] if others else []
