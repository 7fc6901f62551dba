"""`adaptctl export`: a robot's controller as C or WebAssembly, which needs no Python."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from adaptctl.cli.output import FloatingBase, Period, Robot, print_json

if TYPE_CHECKING:
    from adaptctl.codegen import Exported

Law = Annotated[
    str,
    Parameter(
        help="slotine-li, slotine-li-fixed, slotine-li-composite, passivity-integral, task-space, "
        "adaptive-computed-torque, computed-torque or pd-gravity."
    ),
]


def export(
    robot: Robot,
    /,
    *,
    out: Path,
    law: Law = "slotine-li",
    name: str | None = None,
    scalar: Literal["double", "float"] = "double",
    language: Literal["c", "wasm"] = "c",
    control_period: Period = 1e-3,
    bandwidth: float = 4.0,
    unguarded: bool = False,
    check: bool = False,
    anyway: bool = False,
    floating_base: FloatingBase = False,
    json: bool = False,
) -> None:
    """Write a robot's controller, gains by `adaptctl tune`, as code that needs no Python.

    Writes C99 source or a WebAssembly module, with a manifest, into a folder that must not exist, and prints a summary,
    or with `json` the manifest. `bandwidth` is the largest rate, the Λ of Slotine and Li's law, at which errors decay.
    Raises `VerdictError`, unless `anyway`, where the arm does not learn with these gains in `adaptctl tune`, or in a
    `check` diverges, rings, is stopped by its guards or does not learn, and where a build of the C does not repeat
    Python's torques; `NotFoundError` for an unknown robot or law,
    `InputError` for a name or number that is not allowed, float in
    WebAssembly, a joint that moves no inertia or a mass matrix that is not positive definite, for which there are no
    gains; `FileError` for a robot's file that cannot be
    used and a folder that exists or cannot be written, `RankError` where the number of identifiable parameters cannot
    be certified, `LoopError` where kinematic loops cannot be closed.

    Args:
        out: Folder to write, which must not exist.
        name: Begins all names in the code; the robot's unless given.
        scalar: Kind of number in C.
        language: C99 or WebAssembly.
        bandwidth: Largest Λ, 1/s.
        unguarded: Leave out the guards of torques, positions and velocities.
        check: Simulate 600 s first; build and run the C where compilers are.
        anyway: Write it even where it fails in simulation.
        json: Print the manifest instead of a summary.
    """
    from adaptctl.codegen import export as exported
    from adaptctl.codegen.builds import COMPILERS, builds
    from adaptctl.dynamics import load
    from adaptctl.errors import VerdictError
    from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
    from adaptctl.tuning import tune
    from adaptctl.tuning.named_laws import guarded, named_law

    mechanism = load(robot, floating_base=floating_base)
    tuning = tune(mechanism, control_period=control_period, bandwidth=bandwidth)
    if not anyway:
        tuning.validate_learning("--anyway")
    model = ReducedModel(mechanism, fundamental_basis(essential_space(mechanism)))
    chosen = named_law(law, tuning, model)
    controller = chosen if unguarded else guarded(chosen, tuning)
    done = exported(
        controller, out, name=name, scalar=scalar, language=language, unguarded=unguarded, check=check,
        reference=tuning.reference, anyway=anyway,
    )  # fmt: skip
    made = builds(done) if check and language == "c" else ()
    if json:
        print_json(done.manifest | ({"builds": [build._asdict() for build in made]} if made else {}))
    else:
        _print(done)
        for build in made:
            print(f"{build.compiler}: {build.message}")
        if check and language == "c" and not made:
            print(f"not built: no compiler is found, of {', '.join(COMPILERS)}")
    if wrong := [build for build in made if not build.passed]:
        raise VerdictError(f"{out}: not what Python computes: {wrong[0].compiler}: {wrong[0].message}")


def _print(done: Exported) -> None:
    manifest = done.manifest
    print(f"{done.directory}: {', '.join(done.files)}")
    print(f"{manifest['flops']} operations per step, every {manifest['control_period']:g} s; guarded: {manifest['guarded']}")
    if manifest["check"]:
        first, last = (manifest["check"][f"rms_error_{which}_10_s"] for which in ("first", "last"))
        known = first is not None and last is not None
        errors = f": RMS error {first:.3g} at first, {last:.3g} in the end" if known else ""
        print(f"checked over {manifest['check']['duration']:g} s{errors}")
        if manifest["check"]["failure"]:
            print(f"FAILED: in simulation {manifest['check']['failure']}")
    if "state_bytes" in manifest:
        print(f"a state of {manifest['state_bytes']} bytes, about {manifest['stack_bytes_about']} bytes of stack")
        print(f"test it: cc -std=c99 {done.name}.c test_{done.name}.c -lm && ./a.out")
