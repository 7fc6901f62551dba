"""WebAssembly packages with a JavaScript class."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.codegen.c_function import Kind
from adaptctl.codegen.c_package import BRAKING, filled, title
from adaptctl.codegen.initialisation import start_of
from adaptctl.codegen.interface import FAULTS, Brake, Interface, status_bits
from adaptctl.codegen.wasm_module import WasmModule
from adaptctl.dynamics.loops.continuation import MAX_LOST_GAP
from adaptctl.errors import InputError
from adaptctl.version import __version__


def wasm_files(interface: Interface, name: str, scalar: Kind) -> tuple[dict[str, str | bytes], dict[str, Any]]:
    """Files by name, and their manifest entries."""
    if scalar != "double":
        raise InputError("scalar: WebAssembly supports only double; use the language c for float")
    module, start = WasmModule(), start_of(interface, MAX_LOST_GAP)
    law = module.export("law", interface.law)
    more = {"started": start.more}
    if start.walk is not None:
        more |= {"closed": start.walk.step, "regular": start.walk.regular}
    places = {key: module.export(key, routine) for key, routine in more.items() if routine is not None}
    binary, walk, bits = module.binary(), start.walk, status_bits(interface)[len(FAULTS) :]
    rest = np.zeros(interface.controller.dof)
    brake = interface.brake or Brake(rest, rest)
    facts = {
        "joints": interface.controller.dof,
        "reference": interface.controller.reference_size,
        "control_period": interface.control_period,
        "given": _numbers(law.inputs[:5]),
        "memory": _numbers(law.inputs[5 : 5 + len(interface.memory)]),
        "sizes": [field.size for field in interface.memory],
        "torque": _numbers(law.outputs[:1])[0],
        "next": _numbers(law.outputs[1:]),
        "gains": _numbers(law.inputs[5 + len(interface.memory) :]),
        "gain": [float(x) if np.isfinite(x) else float(np.finfo(np.float64).max) for x in interface.controller.packed],
        "start": [_plain(field.values) for field in interface.memory],
        "applied": [interface.memory.index(field) for field in interface.applied],
        "configurations": list(start.configurations),
        "computed": list(start.computed),
        "places": {key: [_numbers(found.inputs), _numbers(found.outputs)] for key, found in places.items()},
        "walk": {"home": _plain(walk.home), "primary": list(walk.primary), "looped": list(walk.looped)}
        if walk
        else None,
        "estimate": interface.memory.index(interface.estimate) if interface.estimate else None,
        "flags": [[k, bit.value] for k, bit in enumerate(bits, start=len(interface.memory) - len(bits))],
        "guarded": interface.guarded,
        "brake": _plain(brake.damping),
        "limit": _plain(brake.limit),
    }
    text = base64.b64encode(binary).decode("ascii")
    told = {"name": name, "title": title(interface), "version": __version__}
    script = filled("controller.js", **told, facts=facts, binary=text)
    about = filled("README.wasm.md", **told, **_words(interface), size=len(binary))
    files: dict[str, str | bytes] = {f"{name}.wasm": binary, f"{name}.js": script, "README.md": about}
    return files, {"wasm_bytes": len(binary), "tolerance": 1e-12}


def _words(interface: Interface) -> dict[str, Any]:
    """Texts of the README on joints, the status and estimates."""
    size, follows = interface.controller.reference_size, interface.follows_joints
    return {
        "joints": interface.joints,
        "reference": f"{size} numbers" + ("" if follows else ", which are not of joints"),
        "period": repr(interface.control_period),
        "bits": status_bits(interface),
        "braking": BRAKING,
        "estimate": interface.estimate,
    }


def _numbers(places: Any) -> list[int]:
    """Places in units of 8 bytes, for a Float64Array."""
    return [at // 8 for at in places]


def _plain(values: Array) -> list[float]:
    return [float(x) for x in np.ravel(values)]
