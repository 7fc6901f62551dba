"""Closed loops as WebAssembly for web pages."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.codegen.interface import Interface
from adaptctl.codegen.wasm_module import WasmModule
from adaptctl.compilation import trace
from adaptctl.compilation.routine import Layout
from adaptctl.control import Controller, Reference, Sinusoids
from adaptctl.control.controller import GAINS
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.control.pytree import leaves, like
from adaptctl.control.references import SinusoidNumbers, sinusoids_at
from adaptctl.dynamics.recursion.kinematics import frames, link_poses
from adaptctl.recording.colors import joint_color
from adaptctl.recording.page import rendered
from adaptctl.scalars import Column, clip
from adaptctl.simulation import Plant
from adaptctl.simulation.effects import Payload
from adaptctl.simulation.law_operations import law_flops
from adaptctl.simulation.period import PlantState

MAX_MODULE_BYTES = 60_000
"""bytes of a module in a page"""
MAX_PAYLOAD_SHARE = 0.25
"""of the arm's mass, for the payload slider"""
MAX_LAW_FLOPS = 3000
"""above which a loop is not traced"""


@dataclass(frozen=True)
class LiveArm:
    """Closed loop that a web page runs live, as a WebAssembly module."""

    binary: bytes
    facts: dict[str, Any]
    label: str = ""

    def html(self, label: str) -> str:
        """HTML of a section that draws the arm and runs it."""
        colors = [joint_color(j).hex for j in range(len(self.facts["joints"]))]
        binary = base64.b64encode(self.binary).decode("ascii")
        content = {"binary": binary, "facts": self.facts, "label": label, "colors": colors}
        return rendered("templates/live.html.jinja", "adaptctl.codegen", **content)


@dataclass(frozen=True, eq=False)
class LiveLoop:
    """Equation of a closed loop over one control period, for a web page."""

    plant: Plant
    controller: Controller[Any]
    reference: Sinusoids

    @property
    def state(self) -> dict[str, int]:
        """Lengths of the columns that pass from one control period to the next, by name."""
        law = self.controller
        return self.plant.sizes | {f"memory_{k}": size for k, size in enumerate(law._memory_sizes.values())}

    @property
    def arguments(self) -> dict[str, int]:
        """Lengths of the columns that `equation` takes, by name."""
        parameters = {"parameters": self.plant.mechanism.equations.parameters, "friction": self.plant.dof}
        return self.state | {"time": 1} | parameters | self.controller.gain_sizes

    def equation(self, time: Column, friction: Column, **columns: Column) -> tuple[Column, ...]:
        """Columns of the closed loop after one control period."""
        law = self.controller.substituted(columns[GAINS]) if GAINS in columns else self.controller
        p, v = self.plant.primary(columns["q"]), columns["v"]
        point = sinusoids_at(time[0], SinusoidNumbers(*(Column(x.tolist()) for x in self.reference.numbers)))
        memory = like(self.controller._blank, (columns[name] for name in self.state if name.startswith("memory")))
        torque, after = law.law(p, v, point, memory)
        limits = np.asarray(self.plant.torque_limits).tolist()
        held = Column(clip(x, -most, most) for x, most in zip(torque, limits, strict=True)) - friction * v
        free = replace(self.plant, torque_limits=np.full(self.plant.dof, np.inf))
        outcome = free.equation(columns | {"torque": held, "noise": Column(())})
        places = [x for frame in frames(self.plant.mechanism.equations.links, columns["q"]) for x in frame.origin]
        passed_on = outcome.q, outcome.v, outcome.drives, outcome.sensors, *leaves(after)
        return (*passed_on, torque, p - point.p, point.p, Column(places))


def live_arm(
    plant: Plant, controller: Controller[Any], reference: Reference, started: PlantState, parameters: Array
) -> LiveArm | str:
    """WebAssembly module of a closed loop, or why there is none."""
    if reason := _obstacle(plant, controller, reference):
        return reason
    loop = LiveLoop(plant, controller.fixed(), reference)  # type: ignore[arg-type]  # _obstacle saw that these are Sinusoids
    module = WasmModule()
    routine = trace(loop.equation, loop.arguments, name="period")
    places = module.export("period", routine)
    binary = module.binary()
    if len(binary) > MAX_MODULE_BYTES:
        size = f"{len(binary) / 1000:.0f} kB"
        return f"its equations need {size} as WebAssembly, above the limit of {MAX_MODULE_BYTES // 1000} kB"
    memory = leaves(controller.init(started.p, started.v))
    first = [started.q, started.v, started.drives, started.sensors, *memory]
    own = dict(zip(loop.arguments, (at // 8 for at in places.inputs), strict=True))
    made = [at // 8 for at in places.outputs]
    facts = _facts(loop, own, made, routine.layout) | {
        "start": [np.ravel(x).tolist() for x in first],
        "parameter": np.asarray(parameters).tolist(),
        "load": _load(plant, parameters),
        "heaviest": _heaviest(plant),
    }
    return LiveArm(binary, facts)


def _obstacle(plant: Plant, controller: Controller[Any], reference: Reference) -> str:
    """The reason why a loop cannot be shown live; empty when it can."""
    if plant.effects:
        names = ", ".join(type(effect).__name__ for effect in plant.effects)
        return f"the effects between controller and joints ({names}) are not supported"
    if not isinstance(reference, Sinusoids):
        return f"its reference is a {type(reference).__name__}, not a sum of sinusoids"
    if (flops := law_flops(controller)) is None or flops > MAX_LAW_FLOPS:
        return f"its law has too many operations for a module of {MAX_MODULE_BYTES // 1000} kB"
    return ""


def _facts(loop: LiveLoop, own: dict[str, int], made: list[int], layout: Layout) -> dict[str, Any]:
    mechanism, states = loop.plant.mechanism, len(loop.state)
    damping = getattr(Interface(loop.controller).innermost, "damping", 1.0)
    poses = link_poses(mechanism, sampled_configurations(mechanism))
    return {
        "period": loop.plant.control_period,
        "joints": [joint.name for joint in mechanism.primary_joints],
        "units": [f"m{joint.kind.position_unit}" for joint in mechanism.primary_joints],
        "state": [own[name] for name in loop.state],
        "next": made[:states],
        "sizes": list(loop.state.values()),
        "time": own["time"],
        "parameters": own["parameters"],
        "friction": own["friction"],
        "gains": own.get(GAINS),
        "gain": loop.controller.packed.tolist() if np.isfinite(loop.controller.packed).all() else [],
        "groups": list(_groups(loop.controller)),
        "damping": np.broadcast_to(damping, loop.plant.dof).tolist(),
        "torque": made[states],
        "error": made[states + 1],
        "goal": made[states + 2],
        "places": made[states + 3],
        "parents": list(mechanism.description.parents),
        "reach": float(np.linalg.norm(poses.translations, axis=-1).max()),
        "size": layout.sizes[-1],
    }


def _groups(controller: Controller[Any]) -> Iterator[dict[str, Any]]:
    names = {"bandwidth": "Λ, bandwidth", "damping": "K, damping", "gain": "Γ, adaptation gain"}
    found: dict[str, list[list[int]]] = {}
    first = 0
    for name, values in controller.numbers.items():
        kind = name.split(".")[-1]
        if kind in names:
            found.setdefault(kind, []).append([first, int(values.size)])
        first += values.size
    for kind, places in found.items():
        yield {"name": names[kind], "places": places}


def _load(plant: Plant, parameters: Array) -> list[float]:
    """Change of parameters (P,) by 1 kg in the last body's origin."""
    description = plant.mechanism.description
    if len(parameters) < len(description.inertial_parameters):
        return []
    loaded = Payload(1.0).added_to(parameters, len(description.bodies) - 1)
    return [float(x) for x in loaded - parameters]


def _heaviest(plant: Plant) -> float:
    masses = [abs(float(link.inertia[0])) for link in plant.mechanism.links]
    return float(f"{max(MAX_PAYLOAD_SHARE * sum(masses), 0.1):.1g}")
