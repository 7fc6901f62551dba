"""`adaptctl identify`: a robot's parameters from logs of its motion."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from os import environ
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from adaptctl.cli.output import Folder, Json, Overwrite, listed, print_json, print_outcome, print_parts, titled
from adaptctl.cli.pairs import Pairs, pairs
from adaptctl.cli.robot import AS_USUAL, RobotFlags

if TYPE_CHECKING:
    from rich.table import Table

    from adaptctl.dynamics import Mechanism
    from adaptctl.identification import Identification
    from adaptctl.identification.estimator_comparison import Amplification

SCHEMA, ENERGIES = "adaptctl/identified/2", "energy-differences"


def identify(
    logs: tuple[Path, ...],
    /,
    *,
    robot: Annotated[str | None, Parameter(metavar="FILE")] = None,
    drives: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    validate: Annotated[tuple[Path, ...], Parameter(metavar="LOG")] = (),
    columns: Annotated[Pairs, Parameter(metavar="WHAT=NAME")] = (),
    units: Annotated[Pairs, Parameter(metavar="WHAT=UNIT")] = (),
    sample_rate: Annotated[float | None, Parameter(metavar="HZ")] = None,
    topic: str | None = None,
    skip_steps: Annotated[tuple[str, ...], Parameter(metavar="STEP")] = (),
    friction: Annotated[str | None, Parameter(metavar="TERMS")] = None,
    cutoff: Annotated[float | None, Parameter(metavar="HZ")] = None,
    prior_weight: float | None = None,
    instrumental_variables: bool | None = None,
    payload: Annotated[Pairs, Parameter(metavar="LOG=LINK")] = (),
    payload_mass: Annotated[float | None, Parameter(metavar="KG")] = None,
    payload_after: Annotated[float | None, Parameter(metavar="S")] = None,
    compensated: bool = False,
    trust_log: bool = False,
    energy_differences: Annotated[float | None, Parameter(metavar="S")] = None,
    template: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    reading: RobotFlags = AS_USUAL,
    out: Folder = Path("results/identify"),
    overwrite: Overwrite = False,
    figures: bool = False,
    json: Json = False,
) -> None:
    """
    Identify a robot's inertial and friction parameters from logs of its motion.

    Writes the identified robot, estimates, validation, recording and report into a folder. The name of an example in
    place of a log, without `robot`, takes the example's files.

    Parameters
    ----------
    logs : list of Path
        Log files: .csv, .parquet, or ROS bags (extra `logs`).
    robot : str
        Robot file, .urdf, .xml (MJCF) or .toml, with prior link parameters.
    drives : Path
        TOML file with the transmission, and the columns of each motor.
    validate : list of Path
        Validation logs. Default: the last 40 % of each log.
    columns : list of str
        Columns, such as position=q{} torque=tau_{joint}; {} is a number from 1, {0} from 0. Or numbers of columns from
        1, such as time=1 position=2-4 torque=5-7.
    units : list of str
        Units of time, position, torque, velocity, such as position=deg.
    sample_rate : float
        Sampling rate, Hz, of logs without usable time stamps.
    topic : str
        Joint-state topic, for a bag with several.
    skip_steps : list of str
        Preprocessing steps to skip: resample, unwrap, velocities, limits, standstill.
    friction : str
        Terms of friction and springs, such as viscous,coulomb,stiffness. Default: cross-validation.
    cutoff : float
        Cut-off frequency of the filter, Hz. Default: cross-validation.
    prior_weight : float
        Weight of the prior link parameters. Default: cross-validation.
    instrumental_variables : bool
        Use instrumental variables, for coarse or noisy encoders. Default: where noise of positions asks for them.
    payload : list of str
        Links or frames at which an unknown body is carried, by log, such as loaded.csv=tool0; it is identified too.
    payload_mass : float
        Mass of that body, kg. Default: identified.
    payload_after : float
        Time in the log at which it is taken, s. Default: from the start, or found if no log is without it.
    compensated : bool
        Add the gravity torques of the robot file, for a robot that compensates its own and logs the rest.
    trust_log : bool
        Take the log as it is, even if other signs, columns or gravity fit far better.
    energy_differences : float
        Also estimate from energy balances over windows of this length, s, for comparison.
    figures : bool
        Also write the report's figures as PNG, PDF and SVG.
    template : Path
        Only write a drives file to edit, from the robot and the names of the first log's columns.

    Raises
    ------
    FileError
        If a file cannot be used or written.
    NotFoundError
        If the robot is unknown.
    InputError
        If an option is out of range, or the logs are at rest, too short, too slow or not this robot's.
    LoopError
        If kinematic loops cannot be closed.
    MissingExtraError
        If a ROS bag is read without the extra `logs`.
    AdaptctlError
        If no consistent estimate is found.
    """
    from adaptctl.folders import replacing_folder
    from adaptctl.identification import identify as identified
    from adaptctl.identification.argument_words import in_flags
    from adaptctl.identification.report import facts, log_lines, verdict
    from adaptctl.optional_packages import validate_for_results

    if template is not None:
        _write_template(template, logs, robot, topic, reading, overwrite)
        return
    validate_for_results()
    named, stated = pairs("--columns", columns), pairs("--units", units)
    with replacing_folder(out, overwrite) as folder, _files(logs, robot, drives) as (logs, robot, drives):
        if energy_differences is not None:
            _validate_comparison(logs, drives, energy_differences)
        mechanism = reading.load(robot)
        found = in_flags(identified)(
            logs,
            mechanism,
            drives,
            validate=validate,
            columns=named,
            units=stated,
            sample_rate=sample_rate,
            topic=topic,
            skip_steps=skip_steps,
            friction=friction,
            cutoff=cutoff,
            prior_weight=prior_weight,
            instrumental_variables=instrumental_variables,
            payloads=pairs("--payload", payload),
            payload_mass=payload_mass,
            payload_after=payload_after,
            compensated=compensated,
            trust_log=trust_log,
        )
        notes = _write(folder, found, robot, mechanism, figures)
        compared = None
        if energy_differences is not None and drives is not None:
            compared = _compared(logs, mechanism, drives, energy_differences, folder / ENERGIES)
    print("".join(f"adaptctl: note: {note}\n" for note in notes), end="", file=sys.stderr)
    if json:
        words = {} if compared is None else {"energy_differences": [case._asdict() for case in compared.measured]}
        print_json(as_builtins(found, out) | words)
    else:
        print_outcome(verdict(found), facts(found), out, found.warnings)
        print_parts([titled("Logs", listed(log_lines(found))), titled("Torques of the joints", _joints(found))])
        print(f"Next: adaptctl tune {out / 'robot.toml'}")
        if compared is not None:
            page = compared.report()
            print()
            print_outcome(page.outcome, page.facts, out / ENERGIES)


def _write_template(
    file: Path, logs: tuple[Path, ...], robot: str | None, topic: str | None, reading: RobotFlags, overwrite: bool
) -> None:
    """Write a drives file to edit, and say how it is used."""
    from adaptctl.errors import InputError
    from adaptctl.files import validate_output, write_text
    from adaptctl.identification.drives_template import drives_template
    from adaptctl.identification.log_files import read_log

    if not logs or robot is None:
        raise InputError("--template needs a log and its robot: adaptctl identify LOG --robot FILE --template FILE")
    validate_output(file, overwrite)
    write_text(file, drives_template(reading.load(robot), read_log(logs[0], topic)))
    print(f"{file}: edit it, then: adaptctl identify {logs[0]} --robot {robot} --drives {file}")


def as_builtins(found: Identification, folder: Path) -> dict[str, Any]:
    """Identification in JSON's types; numbers are in its summary.json."""
    from adaptctl.identification.report import facts, joint_verdicts, log_lines, verdict
    from adaptctl.recording.result import answers

    joints = {joint.name: joint.as_builtins() for joint in joint_verdicts(found)}
    words = {"verdict": verdict(found), "joints": joints, "facts": answers(facts(found))}
    words |= {"logs": dict(log_lines(found)), "warnings": list(found.warnings)}
    return {"schema": SCHEMA, "folder": str(folder), **words}


@contextmanager
def _files(
    logs: tuple[Path, ...], robot: str | None, drives: Path | None
) -> Iterator[tuple[tuple[Path, ...], str, Path | None]]:
    """The logs, the robot and the drives file as given, or those of an example by its name."""
    from adaptctl.errors import InputError
    from adaptctl.identification.examples import NAMES, example

    name = str(logs[0]) if len(logs) == 1 else ""
    if robot is None and name in NAMES and not logs[0].exists():
        with example(name) as files:
            yield (files.log,), str(files.robot), drives or files.drives
    elif robot is None:
        robots = [str(log) for log in logs if log.suffix in (".urdf", ".xml", ".toml")]
        given = (
            f"write --robot {robots[0]}"
            if robots
            else f"give a robot file, or try the example: adaptctl identify {NAMES[0]}"
        )
        raise InputError(f"--robot is missing: {given}")
    else:
        yield logs, robot, drives


def _validate_comparison(logs: tuple[Path, ...], drives: Path | None, window: float) -> None:
    from adaptctl.errors import InputError
    from adaptctl.identification.estimator_comparison import validate_window

    if len(logs) != 1 or drives is None:
        raise InputError("--energy-differences needs exactly one log, with columns and units from a --drives file")
    validate_window(window)


def _compared(logs: tuple[Path, ...], robot: Mechanism, drives: Path, window: float, folder: Path) -> Amplification:
    """Comparison of what two estimators make of torques that are off, written into a folder of its own."""
    from adaptctl.folders import made_folder
    from adaptctl.identification.estimator_comparison import compared_estimators

    found = compared_estimators(logs[0], robot, drives, window)
    made_folder(folder)
    found.write(folder)
    return found


def _write(folder: Path, found: Identification, robot: str, before: Mechanism, figures: bool) -> list[str]:
    """Files of an identification, and notes on what some of them cannot hold."""
    from adaptctl.identification.files import write_identification

    environ.setdefault("MUJOCO_GL", "disable")  # MJCF is written by MuJoCo, whose windows take long to load
    written = write_identification(folder, found, robot, before, figures)
    return [note for one in written if (note := one.note(found)) is not None]


STYLES = {"good": "green", "fair": "yellow", "odd": "bold yellow", "bad": "bold red"}


def _joints(found: Identification) -> Table:
    """Table of the joints' verdicts, coloured."""
    from adaptctl.identification.report import joint_verdicts

    return listed((joint.name, (joint.sentence, STYLES[joint.tone.value])) for joint in joint_verdicts(found))
