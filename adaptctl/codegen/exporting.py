"""Export of a controller to a folder."""

from __future__ import annotations

import hashlib
import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from adaptctl.codegen.c_function import Kind
from adaptctl.codegen.closed_loop_check import default_reference, record
from adaptctl.codegen.interface import Interface, validate_controller
from adaptctl.control import Controller, Reference
from adaptctl.dynamics.loops.single_precision import validate_single_precision
from adaptctl.errors import FileError, InputError, printable
from adaptctl.files import hashed, reason, write_json
from adaptctl.folders import replacing_folder, validate_folder
from adaptctl.optional_packages import needed
from adaptctl.simulation.references import sampled
from adaptctl.version import __version__

Language: TypeAlias = Literal["c", "wasm"]
SCHEMA = "adaptctl/export/2"
MAX_STACK_BYTES = 16 * 1024
"""approximate stack bytes of a tick by default"""
_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while bool class
namespace new delete this template true false and or not xor asm catch private public protected operator throw try
typename using virtual export friend mutable explicit
"""
RESERVED = frozenset(re.findall(r"\w+", _WORDS))
"""Words of C and C++."""
MAX_NAME_LENGTH = 40


@dataclass(frozen=True)
class Exported:
    """
    Folder of an exported controller, with the names of its files and its manifest.

    Parameters
    ----------
    directory : Path
        Absolute path of the folder with the code.
    name : str
        Prefix of the names of all files, functions and types of the code.
    files : tuple of str
        Names of the files in the folder; the last is manifest.json.
    manifest : dict
        Contents of manifest.json, such as the control period in s and the files' hashes; docs/export.md lists the keys.

    Examples
    --------
    >>> exported = adaptctl.export(law, tmp / "code", language="wasm", without_safety_filter=True)
    >>> exported.manifest["control_period"], exported.files[-1]
    (0.001, 'manifest.json')
    >>> len(repr(exported).splitlines())
    1
    """

    directory: Path
    name: str
    files: tuple[str, ...]
    manifest: dict[str, Any]

    def __repr__(self) -> str:
        """Name and folder in one line."""
        return f"<Exported {self.name!r} in {self.directory}: {len(self.files)} files>"


@needed("adaptctl.export")
def export(
    controller: Controller[Any],
    directory: str | Path,
    *,
    name: str | None = None,
    scalar: Kind = "double",
    language: Language = "c",
    without_safety_filter: bool = False,
    check: bool = False,
    reference: Reference | None = None,
    large_stack: bool = False,
    anyway: bool = False,
) -> Exported:
    """
    Write a controller as C99 source or a WebAssembly module that needs no Python.

    Parameters
    ----------
    controller : Controller
        Controller to export: a `SafetyFilter` around a control law, unless `without_safety_filter`.
    directory : str or Path
        Folder to create; it must not exist. If the export fails, no folder is left behind.
    name : str, optional
        Prefix of all names in the code, a C identifier of at most 40 characters. Default: the mechanism's name in lower
        case.
    scalar : {"double", "float"}, default "double"
        Floating-point type of the code; "float" is for C alone. "double" gives the numbers of the simulation.
    language : {"c", "wasm"}, default "c"
        Language of the code. C99 compiles for nearly every processor; WebAssembly runs in browsers.
    without_safety_filter : bool, default False
        If true, a controller without a `SafetyFilter` is accepted. By default it is refused, as the code is to drive a
        robot.
    check : bool, default False
        If true, the closed loop is first simulated for 600 s, and its tracking errors are written into the manifest. By
        default it is not, to save the time.
    reference : Reference, optional
        Motion to follow in the check, and in the control periods that the test program in C repeats. Default: sinusoids
        of 0.1 rad or m (0.05 m in a task space) about the neutral configuration.
    large_stack : bool, default False
        If true, the C code may need more than about 16 kB of stack. By default it may not, as small processors have no
        more.
    anyway : bool, default False
        If true, the code is written even if the check fails, and the manifest says why it failed. By default
        `VerdictError` is raised.

    Returns
    -------
    Exported
        Path of the folder, names of its files, and manifest.

    Raises
    ------
    InputError
        If the controller has no safety filter or overrides `step`, an argument is not as above, the stack is too large,
        single precision is too coarse to close the mechanism's loops, or `check` is asked for a controller without a
        mechanism.
    VerdictError
        If the check fails: the simulated loop diverges, is stopped by the safety filter, has oscillating torques, or
        its estimates do not improve the tracking.
    NonFiniteError
        If the reference is not finite.
    TraceError
        If the control law cannot be compiled, for example because it branches on a value.
    FileError
        If the folder exists or cannot be written.

    Examples
    --------
    >>> exported = adaptctl.export(law, tmp / "code", without_safety_filter=True)
    >>> f"{exported.name}.c" in exported.files
    True
    """
    validate_controller(controller)
    _validate_choice("scalar", scalar, get_args(Kind))
    _validate_choice("language", language, get_args(Language))
    interface = Interface(controller)
    if not (interface.guarded or without_safety_filter):
        raise InputError(
            f"controller: {type(controller).__name__} has no safety limits; wrap it in `SafetyFilter` with the limits "
            "of torques, rates and positions, or pass without_safety_filter=True"
        )
    chosen = _name(interface, name)
    target = absent_folder(directory)
    if scalar == "float" and interface.mechanism is not None:
        validate_single_precision(interface.mechanism, "scalar")
    followed = default_reference(interface) if reference is None else _required(reference, interface)
    outcome = None
    if check:
        from adaptctl.codegen.closed_loop_check import check_closed_loop

        outcome = check_closed_loop(interface, followed, anyway=anyway)
    if language == "wasm":
        from adaptctl.codegen.wasm_package import wasm_files

        files, facts = wasm_files(interface, chosen, scalar)
    else:
        files, facts = _c_files(interface, chosen, scalar, followed, large_stack)
    return _written(
        target, interface, chosen, files, facts | {"scalar": scalar, "language": language, "check": outcome}
    )


def _c_files(
    interface: Interface, name: str, scalar: Kind, reference: Reference, large_stack: bool
) -> tuple[dict[str, str | bytes], dict[str, Any]]:
    from adaptctl.codegen.c_package import TOLERANCE, CPackage, readme

    package = CPackage(interface, name, scalar)
    _ = package.functions
    if package.stack > MAX_STACK_BYTES and not large_stack:
        raise InputError(
            f"controller: a control step would need about {package.stack // 1024} kB of stack, above the limit of "
            f"{MAX_STACK_BYTES // 1024} kB for small processors; use another adaptation law, or pass large_stack=True"
        )
    ticks, last = record(interface, reference)
    files: dict[str, str | bytes] = dict(package.files(ticks, last))
    files["README.md"] = readme(package)
    facts = {
        "state_bytes": package.state_bytes,
        "stack_bytes_about": package.stack,
        "tolerance": TOLERANCE[scalar],
        "vectors": len(ticks),
        "abi_hash": package.hash,
    }
    return files, facts


def _written(
    target: Path, interface: Interface, name: str, files: dict[str, str | bytes], facts: dict[str, Any]
) -> Exported:
    hashes = {file: hashlib.sha256(_bytes(content)).hexdigest() for file, content in files.items()}
    manifest = _manifest(interface, name, facts) | {"files": hashes}
    with replacing_folder(target) as beside:
        for file, content in files.items():
            (beside / file).write_bytes(_bytes(content))
        write_json(beside / "manifest.json", manifest)
    return Exported(target, name, (*files, "manifest.json"), manifest)


def _manifest(interface: Interface, name: str, facts: dict[str, Any]) -> dict[str, Any]:
    mechanism, model, law = interface.mechanism, interface.model, interface.controller
    gains = {field.name: _jsonable(field.values) for field in interface.all_gains}
    columns = list(model.names) if model is not None else None
    return {
        "schema": SCHEMA,
        "name": name,
        "adaptctl": __version__,
        "numpy": np.__version__,
        "spdx": "BSD-3-Clause",
        "law": type(interface.innermost).__name__,
        "adaptation": type(getattr(interface.innermost, "adaptation_law", None)).__name__
        if getattr(interface.innermost, "adaptation_law", None) is not None
        else None,
        "guarded": interface.guarded,
        "control_period": interface.control_period,
        "mechanism": {"name": mechanism.name, "sha256": mechanism.description.sha256} if mechanism else None,
        "basis": {"names": columns, "sha256": hashed(columns)} if columns else None,
        "joints": list(interface.joints),
        "gains": gains,
        "gains_sha256": hashed(gains),
        "flops": interface.law.operations.flops,
        "operations": {str(op): count for op, count in sorted(interface.law.operations.items())},
        "state_numbers": sum(law._memory_sizes.values()),
        **facts,
    }


def _jsonable(values: Any) -> Any:
    plain = np.asarray(values).tolist()
    return json.loads(json.dumps(plain).replace("-Infinity", '"-infinity"').replace("Infinity", '"infinity"'))


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content


def absent_folder(directory: str | Path) -> Path:
    """Absolute path, else `FileError`, also if it exists or cannot be created."""
    try:
        target = Path(os.path.realpath(directory))
        occupied = target.exists()
    except (OSError, TypeError, ValueError) as error:
        given = printable(repr(directory))
        raise FileError(f"directory: expected the path of a folder, got {given} ({reason(error)})") from error
    if occupied:
        raise FileError(f"{directory}: already exists; give a folder that does not exist")
    validate_folder(target)
    return target


def _required(reference: Reference, interface: Interface) -> Reference:
    """Checked reference, else `InputError`."""
    if not callable(reference):
        raise InputError(f"reference: expected a function of time, got {printable(repr(reference))}")
    sampled(reference, np.array([0.0, interface.control_period]), interface.controller.reference_size)
    return reference


def _validate_choice(what: str, value: object, known: tuple[str, ...]) -> None:
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{what}: expected {' or '.join(known)}, got {printable(repr(value))}")


def _name(interface: Interface, name: str | None) -> str:
    """Given or default name, else `InputError`."""
    if name is None:
        own = interface.mechanism.name if interface.mechanism else "controller"
        name = re.sub(r"[^a-z0-9_]", "_", own.lower()).strip("_")[:MAX_NAME_LENGTH]
        name = name if re.match(r"[a-z]", name) else f"arm_{name}"
        return f"{name}_" if name in RESERVED else name
    if (
        not isinstance(name, str)
        or not re.fullmatch(rf"[A-Za-z][A-Za-z0-9_]{{0,{MAX_NAME_LENGTH - 1}}}", name, re.ASCII)
        or name in RESERVED
    ):
        raise InputError(
            f"name: expected a C identifier of at most {MAX_NAME_LENGTH} letters, digits and underscores, "
            f"a letter first and not a keyword of C, got {printable(repr(name))}"
        )
    return name
