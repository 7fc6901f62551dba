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
    ConsistentLift,
    Controller,
    CushionedFloor,
    DeadZone,
    EModification,
    Gradient,
    Guarded,
    LinearController,
    Natural,
    PassivityIntegral,
    PDGravity,
    Projection,
    ReleasedGradient,
    SigmaModification,
    SlotineLi,
    Subspace,
    TaskSpaceSlotineLi,
)
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis

ARM = random_chain(3, 3)
MODEL = ReducedModel.full(ARM)
K = len(MODEL.columns)
TRUE = np.asarray(ARM.inertial_parameters)
GAIN = np.linspace(0.5, 2.0, K)
WIDE = np.full(K, 1e4)
PAIR = ReducedModel.full(random_chain(3, 2))
FEW, FEW_TRUE = GAIN[: len(PAIR.columns)], TRUE[: len(PAIR.columns)]


def slotine_li(adaptation: Any = None, kind: type[SlotineLi] = SlotineLi, **more: Any) -> SlotineLi:
    return kind(MODEL, 6.0, [3.0, 4.0, 2.0], adaptation, 0.9 * TRUE, **more)  # type: ignore[arg-type]


def of_two(adaptation: Any) -> SlotineLi:
    """A law whose operations grow with the cube of the number of parameters, on two links."""
    return SlotineLi(PAIR, 6.0, [3.0, 4.0], adaptation, 0.9 * FEW_TRUE)  # type: ignore[arg-type]


def guarded(law: Controller[Any], torque: float = 50.0, rates: float = 1e4, **more: Any) -> Guarded:
    r = law.dof
    wide = (np.full(r, -6.0), np.full(r, 6.0))
    return Guarded(
        law, np.full(r, torque), np.full(r, rates), position_limits=wide, velocity_limits=np.full(r, 30.0), **more
    )


def linear() -> LinearController:
    """Feedback of the error and of its filtered rate, with the torques that the reference asks for."""
    r, eye = ARM.dof, np.eye(ARM.dof)
    zero = np.zeros((r, r))
    slow, gain = (
        np.hstack([-eye, zero, eye, zero, zero]),
        np.hstack([-200.0 * eye, -20.0 * eye, 200.0 * eye, zero, zero]),
    )
    return LinearController(0.9 * eye, 0.1 * slow, 5.0 * eye, gain, ARM)


LAWS: dict[str, Controller[Any]] = {
    "off": slotine_li(),
    "gradient": slotine_li(GAIN),
    "euler": slotine_li(Gradient(GAIN, theta=0.0, cap=0.0)),
    "capped": slotine_li(Gradient(GAIN, theta=1.0, cap=0.5)),
    "released": slotine_li(ReleasedGradient(GAIN)),
    "matrix": slotine_li(np.diag(GAIN) + 0.1),
    "dead zone": slotine_li(DeadZone(GAIN, np.array([0.05, 0.04, 0.06]))),
    "sigma": slotine_li(SigmaModification(GAIN, 0.2, TRUE)),
    "e": slotine_li(EModification(GAIN, 0.2, TRUE)),
    "composite": slotine_li(Composite(GAIN, 0.3, 15.0)),
    "forgetting": slotine_li(BoundedGainForgetting(GAIN, 0.3, 15.0, 1.5, 3.0)),
    "floor": of_two(CushionedFloor(FEW, 0.3, 15.0, 1.5)),
    "composite learning": of_two(CompositeLearning(FEW, 0.3, 15.0, 1.5, 2.0, 1e-9, 1.0)),
    "concurrent learning": slotine_li(ConcurrentLearning(GAIN, 0.3, 15.0, 3, 1e-9)),
    "natural": slotine_li(Natural(0.2)),
    "lift": of_two(ConsistentLift(0.2, 0.9 * FEW_TRUE, 0.3, 15.0)),
    "lift without prediction": slotine_li(ConsistentLift(0.2, 0.9 * TRUE)),
    "projection": slotine_li(Projection(Gradient(GAIN), -WIDE, WIDE)),
    "projected composite": slotine_li(Projection(Composite(GAIN, 0.3, 15.0), -WIDE, WIDE)),
    "subspace": slotine_li(Subspace(GAIN[:4], np.eye(K)[:, :4])),
    "integral": slotine_li(GAIN, PassivityIntegral),
    "tool": slotine_li(GAIN, TaskSpaceSlotineLi, singularity=0.1, reference_in_joints=True),
    "tool in the world": slotine_li(GAIN, TaskSpaceSlotineLi, singularity=0.1, axes=(0, 1)),
    "adaptive computed torque": AdaptiveComputedTorque(MODEL, 6.0, 0.9 * TRUE, GAIN),  # type: ignore[arg-type]
    "computed torque": ComputedTorque(ARM, np.full(3, 6.0), 0.8),
    "gravity": PDGravity(ARM, np.full(3, 200.0), np.full(3, 30.0)),
    "linear": linear(),
    "guarded": guarded(slotine_li(GAIN), estimate_bounds=(-WIDE, WIDE)),
    "guarded lift": guarded(of_two(ConsistentLift(0.2, 0.9 * FEW_TRUE, 0.3, 15.0)), rates=2e3),
}
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
            few = ReducedModel(ARM, fundamental_basis(essential_space(ARM)))
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
            return ComputedTorque.on(model, 8.0)


REDUCED = ("reduced", "drives", "loop", "guarded loop", "loop composite", "loop tool", "loop computed torque")


def law_named(name: str) -> Controller[Any]:
    return LAWS[name] if name in LAWS else reduced_law(name)
