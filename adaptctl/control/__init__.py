"""Online: control laws, adaptation, gains and references."""

from adaptctl.control.adaptation import (
    AdaptationLaw,
    BoundedGainForgetting,
    Composite,
    CushionedFloor,
    DeadZone,
    EModification,
    Gradient,
    Natural,
    PriorRanges,
    Projection,
    SigmaModification,
    Subspace,
    adaptation_gain,
    limits,
    mapped_gain,
)
from adaptctl.control.adaptive import Adaptive, AdaptiveState
from adaptctl.control.adaptive_computed_torque import AdaptiveComputedTorque
from adaptctl.control.computed_torque import ComputedTorque
from adaptctl.control.controller import Controller, Reference, ReferencePoint
from adaptctl.control.estimates import load_estimate, save_estimate
from adaptctl.control.gains import Gains, sampled_gain, typical_inertia
from adaptctl.control.guards import Guarded, GuardedState
from adaptctl.control.lyapunov import lyapunov, sliding_variable
from adaptctl.control.passivity import PassivityBased
from adaptctl.control.passivity_integral import PassivityIntegral
from adaptctl.control.pd_gravity import PDGravity
from adaptctl.control.references import MinimumJerk, Sinusoids, Spline
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.control.task_space import TaskSpaceSlotineLi

__all__ = [
    "AdaptationLaw",
    "Adaptive",
    "AdaptiveComputedTorque",
    "AdaptiveState",
    "BoundedGainForgetting",
    "Composite",
    "ComputedTorque",
    "Controller",
    "CushionedFloor",
    "DeadZone",
    "EModification",
    "Gains",
    "Gradient",
    "Guarded",
    "GuardedState",
    "MinimumJerk",
    "Natural",
    "PDGravity",
    "PassivityBased",
    "PassivityIntegral",
    "PriorRanges",
    "Projection",
    "Reference",
    "ReferencePoint",
    "SigmaModification",
    "Sinusoids",
    "SlotineLi",
    "Spline",
    "Subspace",
    "TaskSpaceSlotineLi",
    "adaptation_gain",
    "limits",
    "load_estimate",
    "lyapunov",
    "mapped_gain",
    "sampled_gain",
    "save_estimate",
    "sliding_variable",
    "typical_inertia",
]
