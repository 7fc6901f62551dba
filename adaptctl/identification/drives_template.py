"""Drives files to edit, filled from a robot and a log as far as the names of columns tell."""

from __future__ import annotations

from shlex import split

from adaptctl.dynamics import Mechanism
from adaptctl.files import toml_string
from adaptctl.identification.column_names import joint_names, likely_pair, likely_time
from adaptctl.identification.unknown_columns import likely_unit, named_unit
from adaptctl.logs.table import LogTable
from adaptctl.logs.units import OTHER_TORQUE

UNKNOWN = "NAME OF THE COLUMN"
HEAD = """\
# {robot}: how motors turn joints, and which columns of a log are whose; filled as far as the names in {log} tell.
# Check every line. The columns are:
# {columns}
time = {time}
# s, ms, us, ns; rad, mrad, deg, rev, m, mm, or counts as rev/4096; N m, mN m, N, or in proportion: A, mA, %, 1
units = {{ time = {time_unit}, position = {position_unit}, torque = {torque_unit} }}
joints = [{joints}]
# Row i: turns of motor i for one turn of each joint; 1 where the log has the joints' own positions and torques.
transmission = [
{rows}
]
# Positions of the joints where the motors are at zero:
# joint_offsets_deg = [{zeros}]
# torque_constant: N m per unit of the torque's column, or "unknown"; left out where the column is a torque.
# position_unit: of the motor's own position, where it is not that of all, such as "mm" of a joint that slides.
motors = [
{motors}
]
"""


def drives_template(mechanism: Mechanism, log: LogTable) -> str:
    """Text of a drives file for a robot and a log."""
    joints = [joint.name for joint in mechanism.primary_joints]
    found = {what: _columns(what, joints, log) for what in ("position", "torque")}
    time = split(likely_time(log))[0].partition("=")[2]
    time = time if time in log.columns else UNKNOWN
    units = {what: likely_unit(what, names, log) for what, names in ({"time": [time]} | found).items()}
    constant = ', torque_constant = "unknown"' if units["torque"] in OTHER_TORQUE else ""
    own = [named_unit("position", name) for name in found["position"]]
    unit = [f", position_unit = {toml_string(u)}" if u and u != units["position"] else "" for u in own]
    entries = [
        f"    {{ position = {toml_string(p)}, torque = {toml_string(t)}{constant}{unit[i]} }},  # {joint}"
        for i, (joint, p, t) in enumerate(zip(joints, found["position"], found["torque"], strict=True))
    ]
    rows = [f"    [{', '.join('1' if i == j else '0' for j in range(len(joints)))}]," for i in range(len(joints))]
    return HEAD.format(
        robot=mechanism.name,
        log=log.source,
        columns=", ".join(log.columns),
        time=toml_string(time),
        time_unit=toml_string(units["time"]),
        position_unit=toml_string(units["position"]),
        torque_unit=toml_string(units["torque"]),
        joints=", ".join(map(toml_string, joints)),
        rows="\n".join(rows),
        zeros=", ".join("0" for _ in joints),
        motors="\n".join(entries),
    )


def _columns(what: str, joints: list[str], log: LogTable) -> list[str]:
    """Names of the columns that a pattern of likely names finds for each joint, else what to put there."""
    pattern = split(likely_pair(what, joints, log))[0].partition("=")[2]
    names = joint_names(pattern, joints, log) if "{" in pattern else []
    return names if names and all(name in log.columns for name in names) else [UNKNOWN] * len(joints)
