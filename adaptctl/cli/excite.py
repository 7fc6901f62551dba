"""`adaptctl excite`: motions for a robot to run, so that its log tells of its parameters."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from adaptctl.cli.output import Folder, Json, Overwrite, Robot, print_json
from adaptctl.cli.pairs import Pairs, pairs
from adaptctl.cli.robot import AS_USUAL, RobotFlags, validate_posture_flag

if TYPE_CHECKING:
    from adaptctl.dynamics import Mechanism
    from adaptctl.identification.robot_motion import RobotMotion
    from adaptctl.identification.uncertainty import Forecast

Numbers = tuple[float, ...]
SCHEMA = "adaptctl/excitation/1"
MAX_SAMPLE_RATE = 100_000
"""Points a second: robots take a thousand, and files of more than these do not fit."""


def excite(
    robot: Robot,
    /,
    *,
    start: Annotated[Numbers, Parameter(metavar="RAD")] = (),
    end: Annotated[Numbers, Parameter(metavar="RAD")] = (),
    duration: float = 14.0,
    limit_share: float = 0.8,
    acceleration: Annotated[Numbers, Parameter(metavar="RAD/S2")] = (),
    jerk: Annotated[Numbers, Parameter(metavar="RAD/S3")] = (),
    box: Annotated[Numbers, Parameter(metavar="M")] = (),
    noise: Annotated[Numbers, Parameter(metavar="NM")] = (),
    after: Annotated[tuple[Path, ...], Parameter(metavar="LOG")] = (),
    drives: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    columns: Annotated[Pairs, Parameter(metavar="WHAT=NAME")] = (),
    units: Annotated[Pairs, Parameter(metavar="WHAT=UNIT")] = (),
    sample_rate: float = 100.0,
    iterations: int = 10,
    seed: int = 0,
    reading: RobotFlags = AS_USUAL,
    out: Folder = Path("results/excite"),
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """
    Make a motion that excites a robot's parameters, and another to validate on, each from rest to rest.

    Writes both as CSV and for ROS 2, with a recording and forecast.json, the deviations of parameters to be expected.

    Parameters
    ----------
    start : list of float
        Start pose. Default: mid-range.
    end : list of float
        End pose. Default: the start pose.
    duration : float
        Duration, s; longer if the limits require it.
    limit_share : float
        Fraction of the position, velocity and torque limits that may be used.
    acceleration : list of float
        Acceleration limits, one value or one per joint.
    jerk : list of float
        Jerk limits, one value or one per joint.
    box : list of float
        Box that contains the link frames, m: x y z from, x y z to.
    noise : list of float
        Expected torque residuals for the forecast, one value or one per joint.
    after : list of Path
        Earlier logs: the motions excite what these left open, and the forecast is that of all together.
    drives : Path
        TOML file with the transmission of those logs, and their columns.
    columns : list of str
        Columns of those logs, as in `identify`.
    units : list of str
        Units of those columns, as in `identify`.
    sample_rate : float
        Points per second in the files.
    iterations : int
        Iterations of the search.
    seed : int
        Seed of the search; that of the validation trajectory is the next.

    Raises
    ------
    InputError
        If numbers have a wrong count or size, or no motion keeps to the limits.
    NotFoundError
        If the robot is unknown.
    FileError
        If a file cannot be used or written.
    RankError
        If the number of identifiable parameters cannot be certified.
    """
    from adaptctl.arrays import positive_per_joint
    from adaptctl.files import write_json
    from adaptctl.folders import replacing_folder
    from adaptctl.identification.robot_motion import RobotLimits, exciting_motion
    from adaptctl.identification.uncertainty import forecast
    from adaptctl.identification.workspace import workspace
    from adaptctl.recording.motion_recording import record_motion

    mechanism = reading.load(robot)
    _validate_rate(sample_rate)
    for flag, places in (("--start", start), ("--end", end)):
        if places:
            validate_posture_flag(flag, mechanism, places)
    limits = RobotLimits.of(mechanism, limit_share, _each(acceleration), _each(jerk))
    residuals = positive_per_joint(_each(noise), mechanism.dof, "noise") if noise else None
    earlier = _earlier(mechanism, after, drives, columns, units)
    area, first = workspace(mechanism, robot, *_box(box)), start or None
    with replacing_folder(out, overwrite) as folder:
        motions = {
            name: exciting_motion(
                mechanism,
                limits,
                start=first,
                end=end or first,
                duration=duration,
                limit_share=limit_share,
                seed=seed + i,
                iterations=iterations,
                allowed=area.allows,
                earlier=earlier if i == 0 else None,
            )
            for i, name in enumerate(("excitation", "validation"))
        }
        predicted = forecast(mechanism, motions["excitation"], residuals, earlier)
        for name, motion in motions.items():
            _write(folder, name, motion, [joint.name for joint in mechanism.primary_joints], sample_rate)
        content = as_builtins(robot, motions, predicted, area.collides is not None)
        write_json(folder / "forecast.json", content)
        time, p, v, a, _ = motions["excitation"].sampled()
        record_motion(folder / "excitation.rrd", mechanism, time, p, p, mechanism.inverse_dynamics(p, v, a))
    if json:
        print_json(content | {"folder": str(out)})
    else:
        _print(motions, predicted, area.collides is not None, out)


def _each(given: Numbers) -> Any:
    return (given[0] if len(given) == 1 else list(given)) if given else None


def _earlier(mechanism: Mechanism, logs: tuple[Path, ...], drives: Path | None, columns: Pairs, units: Pairs) -> Any:
    """Motion of earlier logs, if there are any."""
    from adaptctl.errors import InputError
    from adaptctl.identification.drives_file import read_drives
    from adaptctl.identification.earlier_motion import read_earlier_motion

    if not logs and (drives or columns or units):
        raise InputError("--drives, --columns and --units are of earlier logs: give them by --after LOG")
    if drives and (columns or units):
        raise InputError("--columns, --units: expected none, because --drives specifies them")
    given = read_drives(drives) if drives else None
    named, in_units = pairs("--columns", columns), pairs("--units", units)
    return read_earlier_motion(mechanism, logs, given, named, in_units) if logs else None


def as_builtins(robot: str, motions: dict[str, RobotMotion], predicted: Forecast, collisions: bool) -> dict[str, Any]:
    """Forecast of an identification in JSON's types; None is infinite."""
    from adaptctl.files import finite_or_none

    columns = zip(predicted.model.names, predicted.deviations.tolist(), predicted.relative.tolist(), strict=True)
    return {
        "schema": SCHEMA,
        "robot": robot,
        "durations": {name: motion.duration for name, motion in motions.items()},
        "self_collision_checked": collisions,
        "condition": finite_or_none(predicted.condition),
        "parameters": {n: {"deviation": finite_or_none(s), "relative": finite_or_none(x)} for n, s, x in columns},
        "combinations": [c._asdict() for c in predicted.combinations],
    }


def _box(given: Numbers) -> tuple[Any, Any]:
    import numpy as np

    from adaptctl.errors import InputError

    if len(given) not in (0, 6):
        raise InputError(f"--box: expected six numbers, x y z from and x y z to, in m, got {len(given)}")
    lower, upper = np.array(given[:3]), np.array(given[3:])
    if given and not np.all(lower < upper):
        raise InputError(f"--box: expected the last three numbers above the first three, got {list(given)}")
    return (lower, upper) if given else (None, None)


def _validate_rate(rate: float) -> None:
    from adaptctl.arrays import positive_number
    from adaptctl.errors import InputError

    positive_number(rate, "sample_rate: expected a positive number of Hz")
    if rate > MAX_SAMPLE_RATE:
        raise InputError(f"sample_rate: expected at most {MAX_SAMPLE_RATE} points per second, got {rate:g}")


def _write(folder: Path, name: str, motion: RobotMotion, joints: list[str], rate: float) -> None:
    from adaptctl.identification.robot_motion import write_csv, write_trajectory

    write_csv(folder / f"{name}.csv", motion, joints, rate)
    for suffix in (".yaml", ".json"):
        write_trajectory(folder / f"{name}{suffix}", motion, joints, rate)


def _print(motions: dict[str, RobotMotion], predicted: Forecast, collisions: bool, folder: Path) -> None:
    import numpy as np

    relative = predicted.relative
    print(
        f"Two trajectories of {' and '.join(f'{motion.duration:.1f} s' for motion in motions.values())}, from rest to "
        "rest."
    )
    print(f"  condition of the scaled regressor    {predicted.condition:.3g}")
    print(f"  parameters known to 10 %              {int(np.sum(relative < 0.1))} of {len(relative)}")
    print(f"  self-collision                       {'checked' if collisions else 'not checked: no collision geometry'}")
    print("  least excited parameter combinations")
    for combination in predicted.combinations[:5]:
        print(f"    {combination.words}   (prior range divided by standard deviation: {combination.strength:.2g})")
    print(f"\nSee:      rerun {folder / 'excitation.rrd'}")
    print(f"Run:      {folder / 'excitation.csv'} (or .yaml, .json), then {folder / 'validation.csv'}")
    print("Then:     adaptctl identify LOG --robot ROBOT --validate OTHER")
