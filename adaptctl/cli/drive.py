"""`adaptctl drive`: a robot driven by the default learning controller, from where it stands to a planned stop."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from adaptctl.cli.interruption import Interruption, interruptible
from adaptctl.cli.output import Folder, Overwrite, WrappedTable, print_parts, titled, words
from adaptctl.cli.robot import AS_USUAL, RobotFlags, validate_posture_flag
from adaptctl.errors import InputError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from adaptctl.dynamics import Mechanism
    from adaptctl.hardware import DrivenRun, TorqueRobot
    from adaptctl.identification import IdentifiedPayload

SCHEMA = "adaptctl/drive/1"
DONE, FAILED = 0, 3
FAST = 60.0
"""rad/s, corner frequency of the observer of external torques"""
MAX_AMPLITUDE = 3.2
"""rad (m)"""
ROUNDING = 1e-12
"""rad (m)"""
Vendor = Literal["franka", "trossen", "ur", "udp", "mujoco"]
OnTouch = Literal["ignore", "stop", "comply", "retract"]


def drive(
    vendor: Annotated[Vendor, Parameter(help="Kind of the robot.")],
    address: Annotated[
        str, Parameter(help="Address of the robot; HOST:PORT for udp, a scene or robot file for mujoco.")
    ],
    /,
    *,
    robot: Annotated[str, Parameter(help="File of the robot: .urdf, .xml (MJCF) or .toml.")],
    duration: float,
    out: Folder,
    amplitude: float = 0.3,
    start: Annotated[tuple[float, ...] | None, Parameter(metavar="RAD")] = None,
    any_kernel: bool = False,
    live: bool = False,
    on_touch: OnTouch = "ignore",
    rotors: Annotated[str | None, Parameter(metavar="TYPE")] = None,
    overwrite: Overwrite = False,
    reading: RobotFlags = AS_USUAL,
) -> int:
    """
    Drive a robot about the posture in which it stands, by the default learning controller.

    The arm starts at rest where it stands and ends at rest. Ctrl-C stops it on its path, a second one by its own means.
    No real arm has been driven yet: keep a hand on the emergency stop.

    Parameters
    ----------
    duration : float
        Duration of the motion, s.
    amplitude : float
        Greatest amplitude of a joint, rad or m. It is less where its end or speed limit is near.
    start : list of float
        Posture in which a simulated arm stands, for mujoco, rad or m. Default: the file's, or mid-range.
    any_kernel : bool
        Accept a kernel without real time, for franka.
    live : bool
        Show the arm in the rerun viewer during the run.
    on_touch : {"ignore", "stop", "comply", "retract"}
        Feel external torques, and stop, yield or go back where they pass the level of one false alarm an hour. "ignore"
        feels nothing.
    rotors : str, optional
        Published rotor inertias to start from, "fr3" or "fr3-menagerie", where the file has none. Default: a guess, or
        those of a simulated robot.

    Returns
    -------
    int
        Exit code: 0, or 3 where the arm was stopped.

    Raises
    ------
    InputError
        If the robot cannot be reached, is another one, moves, or a number is out of range.
    FileError
        If a file cannot be used or written.
    """
    from adaptctl.folders import replacing_folder

    with interruptible() as interruption, replacing_folder(out, overwrite) as folder, ExitStack() as shown:
        arm = reading.load(robot)
        found = connected(vendor, address, arm, any_kernel, start)
        arm = _geared(arm, found, rotors)
        try:
            view = _view(arm, shown) if live else None
            run = _driven(found, arm, (duration, amplitude), folder, view, on_touch, address, interruption)
        except KeyboardInterrupt as stop:
            if not stop.args:
                raise
            interruption.asked, (run,) = True, stop.args
        interruption.hold()
        _write(folder, run, arm)
    print_parts(_report(run, arm, out))
    if interruption.asked:
        raise KeyboardInterrupt
    return FAILED if run.stopped else DONE


def _geared(arm: Mechanism, robot: TorqueRobot, rotors: str | None) -> Mechanism:
    """Arm with rotor inertias: published or guessed ones, or those that a simulated robot has."""
    from adaptctl.hardware import MuJoCoRobot, with_rotors
    from adaptctl.hardware.rotors import having_rotors

    if rotors is not None or not isinstance(robot, MuJoCoRobot):
        return with_rotors(arm, rotors)
    simulated = [joint.drive.rotor_inertia or None for joint in robot.plant.mechanism.primary_joints]
    return having_rotors(arm, dict(zip((joint.name for joint in arm.primary_joints), simulated, strict=False)))


def connected(
    vendor: str, address: str, arm: Mechanism, any_kernel: bool, start: Sequence[float] | None = None
) -> TorqueRobot:
    """Robot at an address, a simulated one in a posture if one is given."""
    from adaptctl import hardware

    if start:
        if vendor != "mujoco":
            raise InputError(f"--start is for mujoco: a {vendor} robot stands where it stands")
        validate_posture_flag("--start", arm, start)
    if vendor == "franka":
        return hardware.FrankaRobot(address, real_time=not any_kernel)
    if vendor == "ur":
        return hardware.URRobot(address, hardware.HardwareLimits.of(arm))
    if vendor == "trossen":
        return hardware.TrossenRobot(address)
    if vendor == "udp":
        return hardware.UDPRobot(address, hardware.HardwareLimits.of(arm, torque_rate=1000.0))
    return hardware.MuJoCoRobot(address, start=start, real_time=True)


def _driven(
    robot: TorqueRobot, arm: Mechanism, motion: tuple[float, float], folder: Path, live: Any, on_touch: OnTouch,
    address: str, interruption: Interruption,
) -> DrivenRun:  # fmt: skip
    from adaptctl.arrays import positive_number
    from adaptctl.control import with_external_torque
    from adaptctl.hardware import HardwareLimits, drive, motion_about, ready_controller
    from adaptctl.hardware.preparation import periods_late
    from adaptctl.hardware.robot import validate_posture

    duration, amplitude = motion
    positive_number(duration, "--duration: expected a positive time in s")
    positive_number(amplitude, "--amplitude: expected a positive amplitude in rad")
    if amplitude > MAX_AMPLITUDE:
        raise InputError(f"--amplitude: expected at most {MAX_AMPLITUDE:g} rad (m), got {amplitude:g}: is it in deg?")
    if robot.limits.dof != arm.dof:
        raise InputError(f"--robot: {arm.name} has {arm.dof} joints, but the robot at {address} {robot.limits.dof}")
    here, limits = robot.read(), robot.limits.within(HardwareLimits.of(arm))
    if here is None:
        raise InputError(f"no measurement came from {address}: is the robot on, and is this its address?")
    validate_posture(here.p, [joint.name for joint in arm.primary_joints], limits)  # tuning takes a while
    reference = motion_about(here.p, limits, amplitude)
    controller = ready_controller(arm, robot.period, reference, getattr(robot, "tool", None), periods_late(robot))
    if on_touch != "ignore":
        controller = with_external_torque(controller, cutoff=min(FAST, 0.5 / robot.period))
    if interruption.asked:  # and lost
        raise KeyboardInterrupt
    return drive(robot, controller, reference, duration, folder / "run.parquet", live=live, on_touch=on_touch)


def _view(arm: Mechanism, shown: ExitStack) -> Any:
    from adaptctl.recording import Live

    return shown.enter_context(Live(arm))


def _write(folder: Path, run: DrivenRun, arm: Mechanism) -> None:
    """Write summary and recording."""
    from adaptctl.files import write_json
    from adaptctl.recording.motion_recording import record_motion

    write_json(folder / "summary.json", as_builtins(run, arm))
    if run.rollout is None:
        return
    kept = run.rollout
    record_motion(folder / "recording.rrd", arm, kept.time, kept.p, kept.reference_p, kept.applied)


def as_builtins(run: DrivenRun, arm: Mechanism) -> dict[str, Any]:
    """Summary of a run in JSON's types."""
    from adaptctl.files import finite_or_none
    from adaptctl.identification import told_numbers

    times, names = run.times, [joint.name for joint in arm.primary_joints]
    return {
        "schema": SCHEMA,
        "robot": {"name": arm.name, "sha256": arm.description.sha256},
        "stopped": run.stopped,
        "stopped_by_robot": run.by_robot,
        "compensates_gravity": run.compensates_gravity,
        "first_error": run.first_error,
        "final_rms_error": {n: finite_or_none(e) for n, e in zip(names, run.final_rms_error, strict=False)},
        "peak_torque_rate": run.peak_torque_rate,
        "peak_speed_share": run.peak_speed_share,
        "control_period": times.period,
        "periods": int(times.histogram.sum()),
        "periods_off": times.off,
        "longest_late_run": times.longest_late,
        "longest_period": times.worst,
        "longest_computation": times.busy,
        "payload": None if run.payload is None else told_numbers(run.payload),
        "touches": [touch._asdict() for touch in run.touches],
        "period_histogram": times.histogram.tolist(),
    }


def _report(run: DrivenRun, arm: Mechanism, out: Path) -> Iterator[RenderableType]:
    from adaptctl.dynamics.joint_units import error_unit, position_units
    from adaptctl.hardware.driven_run import FINAL

    if run.stopped:
        yield words((f"STOPPED: {run.stopped}", "bold red"))
    if run.touches:
        yield words("\n".join(f"touched at {touch.time:.2f} s: {touch}" for touch in run.touches))
    names = [joint.name for joint in arm.primary_joints]
    if run.payload is not None:
        yield words(_carried(run.payload))
    unit, errors = error_unit(arm), zip(names, run.final_rms_error, position_units(arm), strict=False)
    rows = [[name, f"{1e3 * error:.3g} m{of}"] for name, error, of in errors]
    length = min(FINAL, run.rollout.duration) if run.rollout else FINAL
    yield titled(f"RMS error of the last {length:.2g} s", WrappedTable(("joint", "error"), rows))
    yield words(
        f"first error {_thousandths(run.first_error)} {unit}; greatest torque rate {run.peak_torque_rate:.4g} N m/s; "
        f"greatest speed {run.peak_speed_share:.0%} of a limit; {run.times.off} periods off, at most "
        f"{run.times.longest_late} late in a row, the longest {1e3 * run.times.worst:.3g} ms; {_computing(run)}\n{out}"
    )


def _thousandths(error: float) -> str:
    """Error (rad or m) in thousandths, without those of rounding."""
    return f"{1e3 * error:.2g}" if error > ROUNDING else "0"


def _computing(run: DrivenRun) -> str:
    """Longest time from a measurement to its torque, which simulated time waits for and a robot's does not."""
    busy, period = run.times.busy, run.times.period
    late = f", {busy / period:.1f} periods: a robot would not have waited" if busy > period else ""
    return f"longest computation of a torque {1e3 * busy:.3g} ms{late}"


def _carried(payload: IdentifiedPayload) -> str:
    from adaptctl.identification import told

    mass, centre, inertia = told(payload).tolist()
    if not mass:
        return "this motion does not determine what the arm carries"
    if abs(payload.mass) < 2.0 * payload.deviations[0]:
        return f"carries no unknown load, within {2.0 * payload.deviations[0]:.1g} kg"
    open_ones = [name for name, is_told in (("centre", centre), ("inertia", inertia)) if not is_told]
    left = f"; not determined by this motion: {', '.join(open_ones)}" if open_ones else ""
    off = payload.deviations
    at = ", ".join(f"{x:.3g}" for x in payload.center_of_mass)
    where = f", centre ({at}) m (deviation {off[1:4].max():.1g}) in the frame of {payload.link}" if centre else ""
    than = "more" if payload.mass > 0.0 else "less"
    return f"carries {abs(payload.mass):.3g} kg (deviation {off[0]:.1g}) {than} than described{where}{left}"
