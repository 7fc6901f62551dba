"""`adaptctl export`: a robot's controller as C or WebAssembly, which needs no Python."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from adaptctl.cli.output import Period, Robot, print_json, print_note
from adaptctl.cli.robot import AS_USUAL, RobotFlags

if TYPE_CHECKING:
    from adaptctl.codegen import Exported

Law = Annotated[
    str,
    Parameter(
        help="slotine-li, slotine-li-learning, slotine-li-fixed, slotine-li-composite, passivity-integral, task-space, "
        "adaptive-computed-torque, computed-torque or pd-gravity."
    ),
]


LEARNING = "slotine-li-learning"
DEFAULT_LAWS = {"double": LEARNING, "float": "slotine-li"}
"""Laws by number: learning needs double precision."""


def export(
    robot: Robot,
    /,
    *,
    out: Path,
    law: Law | None = None,
    name: str | None = None,
    scalar: Literal["double", "float"] = "double",
    language: Literal["c", "wasm"] = "c",
    control_period: Period = 1e-3,
    bandwidth: float = 4.0,
    without_safety_filter: bool = False,
    check: bool = False,
    anyway: bool = False,
    reading: RobotFlags = AS_USUAL,
    json: bool = False,
) -> None:
    """
    Write a robot's controller, with the gains of `adaptctl tune`, as code that needs no Python.

    Parameters
    ----------
    out : Path
        Folder to write, which must not exist.
    law : str
        Control law. Default: slotine-li-learning, and slotine-li in single precision.
    name : str
        Prefix of all names in the code. Default: the name of the robot.
    scalar : str
        Floating-point type in C.
    language : str
        C99 or WebAssembly.
    bandwidth : float
        Largest bandwidth Λ, 1/s.
    without_safety_filter : bool
        Export the controller without limits of torques, positions and velocities.
    check : bool
        Simulate 600 s first; compile and run the C code with the installed compilers.
    anyway : bool
        Write the folder even if the simulation fails.
    json : bool
        Print the manifest instead of a summary.

    Raises
    ------
    VerdictError
        If the robot does not learn, a check fails, or a build of the C does not repeat Python's torques.
    InputError
        If an argument is not as above, or there are no gains.
    NotFoundError
        If the robot or the law is unknown.
    FileError
        If a file cannot be used, or the folder exists or cannot be written.
    RankError
        If the number of identifiable parameters cannot be certified.
    LoopError
        If kinematic loops cannot be closed.
    """
    from adaptctl.codegen import export as exported
    from adaptctl.codegen.builds import COMPILERS, builds
    from adaptctl.codegen.exporting import absent_folder
    from adaptctl.dynamics.joint_units import error_unit
    from adaptctl.errors import VerdictError
    from adaptctl.identifiability import ReducedModel
    from adaptctl.tuning import tune
    from adaptctl.tuning.named_laws import guarded, named_law
    from adaptctl.tuning.rotors import warn_of_rotors

    absent_folder(out)
    mechanism = reading.load(robot)
    warn_of_rotors(mechanism)
    model = ReducedModel(mechanism)
    if check:
        compiled = " and compiles the code with each C compiler found" if language == "c" else ""
        print_note(f"--check simulates 600 s{compiled}: up to {_lasting(len(model.columns))} on a quiet machine")
    tuning = tune(mechanism, control_period=control_period, bandwidth=bandwidth, nominal_only=True)
    if not anyway:
        tuning.validate_learning("--anyway")
    named = law or DEFAULT_LAWS[scalar]
    chosen = named_law(named, tuning, model)
    controller = chosen if without_safety_filter else guarded(chosen, tuning)
    done = exported(
        controller, out, name=name, scalar=scalar, language=language,
        without_safety_filter=without_safety_filter, check=check, reference=tuning.reference, anyway=anyway,
        large_stack=named == LEARNING,
    )  # fmt: skip
    made = builds(done) if check and language == "c" else ()
    if json:
        print_json(done.manifest | ({"builds": [build._asdict() for build in made]} if made else {}))
    else:
        _print(done, error_unit(mechanism))
        for build in made:
            print(f"{build.compiler}: {build.message}")
        if check and language == "c" and not made:
            print(f"not built: found none of these compilers: {', '.join(COMPILERS)}")
    if wrong := [build for build in made if not build.passed]:
        raise VerdictError(f"{out}: the compiled code fails its test: {wrong[0].compiler}: {wrong[0].message}")


SECONDS_PER_SQUARE = 0.025
"""s of a check over the square of the number of parameters: the learning law's operations are so many"""


def _lasting(parameters: int) -> str:
    """Time of a check in words."""
    seconds = 5 * max(1, round(SECONDS_PER_SQUARE * parameters**2 / 5))
    return f"{seconds} s" if seconds < 90 else f"{round(seconds / 60)} minutes"


def _print(done: Exported, unit: str) -> None:
    from adaptctl.codegen.exporting import MAX_STACK_BYTES

    manifest = done.manifest
    print(f"{done.directory}: {', '.join(done.files)}")
    limits = "with" if manifest["guarded"] else "without"
    print(
        f"{manifest['flops']} operations per control step, every {manifest['control_period']:g} s; {limits} safety "
        "limits"
    )
    if manifest["check"]:
        first, last = (manifest["check"][f"rms_error_{which}_10_s"] for which in ("first", "last"))
        known = first is not None and last is not None
        errors = f": initial RMS error {1e3 * first:.3g} {unit}, final {1e3 * last:.3g} {unit}" if known else ""
        print(f"checked over {manifest['check']['duration']:g} s{errors}")
        if manifest["check"]["failure"]:
            print(f"FAILED: in simulation {manifest['check']['failure']}")
    if "state_bytes" in manifest:
        print(f"state: {manifest['state_bytes']} bytes; stack: about {manifest['stack_bytes_about']} bytes")
        if manifest["stack_bytes_about"] > MAX_STACK_BYTES:
            print("on a small processor, --law slotine-li needs less")
        print(
            f"test it: cd {quote(str(done.directory))} && cc -std=c99 {done.name}.c test_{done.name}.c -lm && ./a.out"
        )
