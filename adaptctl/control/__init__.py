"""Online: control laws, adaptation, gains and references."""

from adaptctl.control.adaptation import PriorRanges, adaptation_gain, mapped_gain
from adaptctl.control.computed_torque import ComputedTorque
from adaptctl.control.controller import Controller, Reference, ReferencePoint
from adaptctl.control.gains import Gains, sampled_gain, typical_inertia
from adaptctl.control.lyapunov import lyapunov, sliding_variable
from adaptctl.control.references import MinimumJerk, Sinusoids
from adaptctl.control.slotine_li import SlotineLi, SlotineLiState

__all__ = [
    "ComputedTorque",
    "Controller",
    "Gains",
    "MinimumJerk",
    "PriorRanges",
    "Reference",
    "ReferencePoint",
    "Sinusoids",
    "SlotineLi",
    "SlotineLiState",
    "adaptation_gain",
    "lyapunov",
    "mapped_gain",
    "sampled_gain",
    "sliding_variable",
    "typical_inertia",
]
