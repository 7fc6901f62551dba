"""Every law that the library offers, on a small arm, and laws on a loop: for tests of what all of them do."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from random_trees import random_chain
from sampled_loops import gains, own_gain, reduced

from adaptctl.control import (
    AdaptiveComputedTorque,
    BoundedGainForgetting,
    Composite,
    CompositeLearning,
    ComputedTorque,
    ConcurrentLearning,
    ConsistentAdaptation,
    Controller,
    CushionedFloor,
    DeadZone,
    EModification,
    ExternalTorque,
    Gradient,
    GuardedLearning,
    JointImpedance,
    LeakyIntegral,
    LinearController,
    Natural,
    PassivityIntegral,
    PDGravity,
    Projection,
    ReleasedGradient,
    SafetyFilter,
    SigmaModification,
    SlotineLi,
    Subspace,
    TaskImpedance,
    TaskSpaceSlotineLi,
)
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel

ARM = random_chain(3, 3)
MODEL = ReducedModel.full(ARM)
K = len(MODEL.columns)
TRUE = np.asarray(ARM.inertial_parameters)
GAIN = np.linspace(0.5, 2.0, K)
WIDE = np.full(K, 1e4)
PAIR = ReducedModel.full(random_chain(3, 2))
FEW = GAIN[: len(PAIR.columns)]


def slotine_li(adaptation: Any = None, kind: type[SlotineLi] = SlotineLi, **more: Any) -> SlotineLi:
    return on(MODEL, adaptation, kind, **more)


def on(model: ReducedModel, adaptation: Any, kind: type[Any] = SlotineLi, **more: Any) -> Any:
    """A law that begins nine tenths of the way to the truth."""
    damping = [3.0, 4.0, 2.0][: model.mechanism.dof]
    return kind(model, 6.0, damping, adaptation, 0.9 * true_of(model), **more)  # type: ignore[arg-type]


def true_of(model: ReducedModel) -> Any:
    return np.asarray(model.mechanism.inertial_parameters)


def of_two(adaptation: Any) -> SlotineLi:
    """A law whose operations grow with the cube of the number of parameters, on two links."""
    return on(PAIR, adaptation)


def guarded(law: Controller[Any], torque: float = 50.0, rates: float = 1e4, **more: Any) -> SafetyFilter:
    r = law.dof
    wide = (np.full(r, -6.0), np.full(r, 6.0))
    return SafetyFilter(
        law, np.full(r, torque), np.full(r, rates), position_limits=wide, velocity_limits=np.full(r, 30.0), **more
    )


def tool_impedance() -> dict[str, Any]:
    return {"tool_stiffness": [50.0, 40.0, 0, 0, 0, 2.0], "tool_damping": [2.0, 1.0, 0, 0, 0, 0.1]}


def target_inertia() -> dict[str, Any]:
    driven = {"inertia": 0.5, "tool_inertia": [3.0, 2.0, 0, 0, 0, 0.2], "force_cutoff": 300.0, "surroundings": 1.0}
    return {**tool_impedance(), **driven, "tool_damping": [20.0, 10.0, 0, 0, 0, 1.0]}


def linear(arm: Mechanism = ARM) -> LinearController:
    """Feedback of the error and of its filtered rate, with the torques that the reference asks for."""
    r, eye = arm.dof, np.eye(arm.dof)
    zero = np.zeros((r, r))
    slow, gain = (
        np.hstack([-eye, zero, eye, zero, zero]),
        np.hstack([-200.0 * eye, -20.0 * eye, 200.0 * eye, zero, zero]),
    )
    return LinearController(0.9 * eye, 0.1 * slow, 5.0 * eye, gain, arm)


def laws_on(model: ReducedModel, pair: ReducedModel) -> dict[str, Controller[Any]]:
    """Every law, by name, on one arm, and laws that are long on many parameters on another, of two joints."""
    arm, true, few_true = model.mechanism, true_of(model), true_of(pair)
    gain, few, wide = np.linspace(0.5, 2.0, len(true)), FEW, np.full(len(true), 1e4)
    band, each, axes = np.array([0.05, 0.04, 0.06])[: arm.dof], np.ones(arm.dof), (0, 1, 2)[: arm.dof]
    return {
        "off": on(model, None),
        "gradient": on(model, gain),
        "euler": on(model, Gradient(gain, theta=0.0, cap=0.0)),
        "capped": on(model, Gradient(gain, theta=1.0, cap=0.5)),
        "released": on(model, ReleasedGradient(gain)),
        "matrix": on(model, np.diag(gain) + 0.1),
        "dead zone": on(model, DeadZone(gain, band)),
        "sigma": on(model, SigmaModification(gain, 0.2, true)),
        "e": on(model, EModification(gain, 0.2, true)),
        "composite": on(model, Composite(gain, 0.3, 15.0)),
        "forgetting": on(model, BoundedGainForgetting(gain, 0.3, 15.0, 1.5, 3.0)),
        "floor": on(pair, CushionedFloor(few, 0.3, 15.0, 1.5)),
        "composite learning": on(pair, CompositeLearning(few, 0.3, 15.0, 1.5, 2.0, 1e-9, 1.0)),
        "concurrent learning": on(model, ConcurrentLearning(gain, 0.3, 15.0, 3, 1e-9)),
        "guarded learning": on(pair, GuardedLearning(few, 0.3, 15.0, 1.5, 2.0)),
        "touch": on(pair, GuardedLearning(few, 0.3, 15.0, 1.5, 2.0, delay=2, external_torque=ExternalTorque())),
        "natural": on(model, Natural(0.2)),
        "lift": on(pair, ConsistentAdaptation(0.2, 0.9 * few_true, 0.3, 15.0)),
        "lift without prediction": on(model, ConsistentAdaptation(0.2, 0.9 * true)),
        "projection": on(model, Projection(Gradient(gain), -wide, wide)),
        "projected composite": on(model, Projection(Composite(gain, 0.3, 15.0), -wide, wide)),
        "subspace": on(model, Subspace(gain[:4], np.eye(len(true))[:, :4])),
        "integral": on(model, gain, PassivityIntegral),
        "leaky integral": on(model, gain, LeakyIntegral, leak=3.0, integral_share=0.01, added_rate=90.0),
        "tool": on(model, gain, TaskSpaceSlotineLi, singularity=0.1, axes=axes, reference_in_joints=True),
        "tool in the world": on(model, gain, TaskSpaceSlotineLi, singularity=0.1, axes=(0, 1)),
        "joint impedance": on(pair, few, JointImpedance),
        "target inertia": on(pair, few, TaskImpedance, delay=1, **target_inertia()),
        "impedance": on(pair, few, TaskImpedance, tank=3.0, most_force=5.0, delay=1, **tool_impedance()),
        "adaptive computed torque": AdaptiveComputedTorque(model, 6.0, 0.9 * true, gain),  # type: ignore[arg-type]
        "computed torque": ComputedTorque(arm, 6.0 * each, 0.8),
        "gravity": PDGravity(arm, 200.0 * each, 30.0 * each),
        "linear": linear(arm),
        "guarded": guarded(on(model, gain), estimate_bounds=(-wide, wide)),
        "guarded lift": guarded(on(pair, ConsistentAdaptation(0.2, 0.9 * few_true, 0.3, 15.0)), rates=2e3),
    }


LAWS = laws_on(MODEL, PAIR)
"""By name; small chains, so that each takes a moment."""


@cache
def reduced_law(name: str) -> Controller[Any]:
    """Laws on fundamental parameters: of the small arm, of one with drives, and of one with a loop that `init` has to
    close."""
    robot = "puma560_geared" if name == "drives" else "semi_direct_drive"
    model, own, gain = reduced(robot), gains(robot), own_gain(robot)
    law = SlotineLi(model, own.bandwidth, own.damping, gain)
    match name:
        case "reduced":
            few = ReducedModel(ARM)
            return SlotineLi(few, 6.0, [3.0, 4.0, 2.0], GAIN[: len(few.columns)])  # type: ignore[arg-type]
        case "drives" | "loop":
            return law
        case "guarded loop":
            return guarded(law)
        case "loop composite":
            return SlotineLi(model, own.bandwidth, own.damping, Composite(gain, 0.1))
        case "loop tool":
            more: Any = {"reference_in_joints": True, "singularity": 0.1}
            return TaskSpaceSlotineLi(model, own.bandwidth, own.damping, gain, **more)
        case _:
            return ComputedTorque.from_model(model, 8.0)


REDUCED = ("reduced", "drives", "loop", "guarded loop", "loop composite", "loop tool", "loop computed torque")


def law_named(name: str) -> Controller[Any]:
    return LAWS[name] if name in LAWS else reduced_law(name)
