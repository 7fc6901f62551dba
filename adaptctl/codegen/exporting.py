"""`adaptctl.export`: a controller as a folder that needs no Python."""

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
from adaptctl.folders import replacing_folder
from adaptctl.optional_packages import needed
from adaptctl.simulation.references import sampled
from adaptctl.version import __version__

Language: TypeAlias = Literal["c", "wasm"]
SCHEMA = "adaptctl/export/2"
MOST_STACK = 16 * 1024
"""bytes, about, that a tick may take unless more is asked for"""
_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while bool class
namespace new delete this template true false and or not xor asm catch private public protected operator throw try
typename using virtual export friend mutable explicit
"""
RESERVED = frozenset(re.findall(r"\w+", _WORDS))
"""Words of C and C++."""
LONGEST_NAME = 40


@dataclass(frozen=True)
class Exported:
    """An exported controller: the absolute path of its folder, `directory`; the `name` that begins its code's names;
    the names of the `files` in the folder, the manifest's last; and the contents of its `manifest`, a dict in JSON's
    types, None for null. Nothing is checked.

    The manifest has "schema", "name", "adaptctl", "numpy" (versions), "spdx" (licence), "law", "adaptation" (names of
    classes), "guarded", "control_period" (s), "mechanism" and "basis" (names and hashes), "joints", "gains" (by name,
    SI units), "gains_sha256", "flops" (the number of additions, subtractions, multiplications, divisions and negations
    in a control period), "operations" (the number of each kind), "state_numbers" (how many numbers the internal state
    has), "scalar", "language", "check" (outcome of the simulation that checked it, None without), "tolerance" (of
    torques, in parts of the largest) and "files" (their SHA-256); in C also "state_bytes", "stack_bytes_about",
    "vectors" (ticks recorded) and "abi_hash", in WebAssembly "wasm_bytes".
    """

    directory: Path
    name: str
    files: tuple[str, ...]
    manifest: dict[str, Any]


@needed("adaptctl.export")
def export(
    controller: Controller[Any],
    directory: str | Path,
    *,
    name: str | None = None,
    scalar: Kind = "double",
    language: Language = "c",
    unguarded: bool = False,
    check: bool = False,
    reference: Reference | None = None,
    large_stack: bool = False,
    anyway: bool = False,
) -> Exported:
    """Write a controller's tick, its work of one control period, as C99 source or a WebAssembly module, in a folder
    that needs no Python; returns the `Exported`, with its manifest.

    `directory` must not exist; folders above it are made, and it is there whole or not at all. `name` begins all names
    in the code, a C identifier of at most 40 characters, a letter first and no keyword: the mechanism's name in lower
    case unless given. `language` is "c" or "wasm", `scalar` the kind of number, "double" or in C "float". With `check`
    the closed loop is simulated for 600 s along `reference`, and its root mean square errors in joints, rad (m if
    prismatic), go into the manifest; in C, ticks recorded near the reference go into the code's tests. `reference` is a
    function of time (s); None, the default, is for one of sinusoids of 0.1 rad or m (0.05 m in a task space) about the
    home configuration, or as near to it as joint limits allow. A `check` that fails is an error; with `anyway` the code
    is written all the same, and the manifest says what failed. A controller should be `SafetyFilter`: `unguarded` lets
    one without guards go. `large_stack` allows more than about 16 kB of stack a tick in C.

    Raises `InputError` where `controller` is no `Controller`, overrides `step`, or has no guards without `unguarded`;
    for another `name`, `scalar` or `language` than these and for float in WebAssembly; for a stack above about 16 kB
    without `large_stack`, and for kinematic loops that single precision leaves open by 1e-5 m or rad; for a `reference`
    that is not callable or has another number of coordinates than the controller's; and for a `check` that has no
    mechanism to run on. Raises `VerdictError`, unless `anyway`, for a `check` that becomes non-finite, is stopped by
    guards, rings or does not learn, `NonFiniteError` for a reference that is not
    finite, `TraceError` for a law that cannot be traced, and `FileError` where `directory` is no path, exists or cannot
    be written.
    """
    validate_controller(controller)
    _validate_choice("scalar", scalar, get_args(Kind))
    _validate_choice("language", language, get_args(Language))
    interface = Interface(controller)
    if not (interface.guarded or unguarded):
        raise InputError(
            f"controller: {type(controller).__name__} has no guards: wrap it in `SafetyFilter` with the torques, "
            f"rates and "
            "positions that the arm may have, or say that it may go unguarded"
        )
    chosen = _name(interface, name)
    target = _absent(directory)
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
    if package.stack > MOST_STACK and not large_stack:
        raise InputError(
            f"controller: a tick would take about {package.stack // 1024} kB of stack, at most {MOST_STACK // 1024} kB "
            "is common on small processors: choose another adaptation law, or ask for a large stack"
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
    """Contents of the manifest, in JSON's types."""
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
    """Numbers in JSON, which has no infinity."""
    plain = np.asarray(values).tolist()
    return json.loads(json.dumps(plain).replace("-Infinity", '"-infinity"').replace("Infinity", '"infinity"'))


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content


def _absent(directory: str | Path) -> Path:
    """The absolute path. Raises `FileError` for what is no path, and where something is."""
    try:
        target = Path(os.path.realpath(directory))
        occupied = target.exists()
    except (OSError, TypeError, ValueError) as error:
        given = printable(repr(directory))
        raise FileError(f"directory: expected the path of a folder, got {given} ({reason(error)})") from error
    if occupied:
        raise FileError(f"{directory}: exists already; choose a folder that does not")
    return target


def _required(reference: Reference, interface: Interface) -> Reference:
    """The reference. Raises `InputError` where it is no function of times, or of another number of coordinates."""
    if not callable(reference):
        raise InputError(f"reference: expected a function of time, got {printable(repr(reference))}")
    sampled(reference, np.array([0.0, interface.control_period]), interface.controller.reference_size)
    return reference


def _validate_choice(what: str, value: object, known: tuple[str, ...]) -> None:
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{what}: expected {' or '.join(known)}, got {printable(repr(value))}")


def _name(interface: Interface, name: str | None) -> str:
    """The name that was given, or one made of the mechanism's. Raises `InputError` for no C identifier."""
    if name is None:
        own = interface.mechanism.name if interface.mechanism else "controller"
        name = re.sub(r"[^a-z0-9_]", "_", own.lower()).strip("_")[:LONGEST_NAME]
        name = name if re.match(r"[a-z]", name) else f"arm_{name}"
        return f"{name}_" if name in RESERVED else name
    if (
        not isinstance(name, str)
        or not re.fullmatch(rf"[A-Za-z][A-Za-z0-9_]{{0,{LONGEST_NAME - 1}}}", name, re.ASCII)
        or name in RESERVED
    ):
        raise InputError(
            f"name: expected a C identifier of at most {LONGEST_NAME} letters, digits and underscores, a letter first "
            f"and no word of C, got {printable(repr(name))}"
        )
    return name
