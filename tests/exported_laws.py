"""Every law, on a small arm and on a loop, for tests of what is exported."""

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
    ComputedTorque,
    Controller,
    CushionedFloor,
    DeadZone,
    EModification,
    Gradient,
    Guarded,
    Natural,
    PassivityIntegral,
    PDGravity,
    Projection,
    SigmaModification,
    SlotineLi,
    Subspace,
    TaskSpaceSlotineLi,
)
from adaptctl.identifiability import ReducedModel

ARM = random_chain(3, 3)
MODEL = ReducedModel.full(ARM)
K = len(MODEL.columns)
TRUE = np.asarray(ARM.inertial_parameters)
GAIN = np.linspace(0.5, 2.0, K)
WIDE = np.full(K, 1e4)


def slotine_li(adaptation: Any = None, kind: type[SlotineLi] = SlotineLi, **more: Any) -> SlotineLi:
    return kind(MODEL, 6.0, [3.0, 4.0, 2.0], adaptation, 0.9 * TRUE, **more)  # type: ignore[arg-type]


def guarded(law: Controller[Any], torque: float = 50.0, **more: Any) -> Guarded:
    r = law.dof
    wide = (np.full(r, -6.0), np.full(r, 6.0))
    return Guarded(
        law, np.full(r, torque), np.full(r, 1e4), position_limits=wide, velocity_limits=np.full(r, 30.0), **more
    )


LAWS: dict[str, Controller[Any]] = {
    "off": slotine_li(),
    "gradient": slotine_li(GAIN),
    "euler": slotine_li(Gradient(GAIN, theta=0.0, cap=0.0)),
    "capped": slotine_li(Gradient(GAIN, theta=1.0, cap=0.5)),
    "matrix": slotine_li(np.diag(GAIN) + 0.1),
    "dead zone": slotine_li(DeadZone(GAIN, np.array([0.05, 0.04, 0.06]))),
    "sigma": slotine_li(SigmaModification(GAIN, 0.2, TRUE)),
    "e": slotine_li(EModification(GAIN, 0.2, TRUE)),
    "composite": slotine_li(Composite(GAIN, 0.3, 15.0)),
    "forgetting": slotine_li(BoundedGainForgetting(GAIN, 0.3, 15.0, 1.5, 3.0)),
    "floor": slotine_li(CushionedFloor(GAIN, 0.3, 15.0, 1.5)),
    "natural": slotine_li(Natural(0.2)),
    "projection": slotine_li(Projection(Gradient(GAIN), -WIDE, WIDE)),
    "projected composite": slotine_li(Projection(Composite(GAIN, 0.3, 15.0), -WIDE, WIDE)),
    "subspace": slotine_li(Subspace(GAIN[:4], np.eye(K)[:, :4])),
    "integral": slotine_li(GAIN, PassivityIntegral),
    "tool": slotine_li(GAIN, TaskSpaceSlotineLi, singularity=0.1, reference_in_joints=True),
    "tool in the world": slotine_li(GAIN, TaskSpaceSlotineLi, singularity=0.1, axes=(0, 1)),
    "adaptive computed torque": AdaptiveComputedTorque(MODEL, 6.0, 0.9 * TRUE, GAIN),  # type: ignore[arg-type]
    "computed torque": ComputedTorque(ARM, np.full(3, 6.0), 0.8),
    "gravity": PDGravity(ARM, np.full(3, 200.0), np.full(3, 30.0)),
    "guarded": guarded(slotine_li(GAIN), estimate_bounds=(-WIDE, WIDE)),
}
"""By name; small chains, so that each takes a moment."""


@cache
def looped(name: str) -> Controller[Any]:
    """Laws on the semi-direct-drive arm, whose loop `init` has to close."""
    model, own = reduced("semi_direct_drive"), gains("semi_direct_drive")
    gain = own_gain("semi_direct_drive")
    law = SlotineLi(model, own.bandwidth, own.damping, gain)
    return {
        "loop": law,
        "guarded loop": guarded(law),
        "loop composite": SlotineLi(model, own.bandwidth, own.damping, Composite(gain, 0.1)),
        "loop tool": TaskSpaceSlotineLi(
            model, own.bandwidth, own.damping, gain, reference_in_joints=True, singularity=0.1
        ),
        "loop computed torque": ComputedTorque.on(model, 8.0),
    }[name]


LOOPED = ("loop", "guarded loop", "loop composite", "loop tool", "loop computed torque")


def law_named(name: str) -> Controller[Any]:
    return LAWS[name] if name in LAWS else looped(name)
