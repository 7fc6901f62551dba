"""Online: control laws, adaptation, gains and references."""

from typing import TYPE_CHECKING

from adaptctl.lazily import imported_lazily

if TYPE_CHECKING:
    from adaptctl.control.adaptation import AdaptationLaw as AdaptationLaw
    from adaptctl.control.adaptation import BoundedGainForgetting as BoundedGainForgetting
    from adaptctl.control.adaptation import Composite as Composite
    from adaptctl.control.adaptation import CushionedFloor as CushionedFloor
    from adaptctl.control.adaptation import DeadZone as DeadZone
    from adaptctl.control.adaptation import EModification as EModification
    from adaptctl.control.adaptation import Gradient as Gradient
    from adaptctl.control.adaptation import Natural as Natural
    from adaptctl.control.adaptation import PriorRanges as PriorRanges
    from adaptctl.control.adaptation import Projection as Projection
    from adaptctl.control.adaptation import SigmaModification as SigmaModification
    from adaptctl.control.adaptation import Subspace as Subspace
    from adaptctl.control.adaptation import adaptation_gain as adaptation_gain
    from adaptctl.control.adaptation import limits as limits
    from adaptctl.control.adaptation import mapped_gain as mapped_gain
    from adaptctl.control.adaptive import Adaptive as Adaptive
    from adaptctl.control.adaptive import AdaptiveState as AdaptiveState
    from adaptctl.control.adaptive_computed_torque import AdaptiveComputedTorque as AdaptiveComputedTorque
    from adaptctl.control.computed_torque import ComputedTorque as ComputedTorque
    from adaptctl.control.controller import Controller as Controller
    from adaptctl.control.controller import Reference as Reference
    from adaptctl.control.controller import ReferencePoint as ReferencePoint
    from adaptctl.control.estimates import load_estimate as load_estimate
    from adaptctl.control.estimates import save_estimate as save_estimate
    from adaptctl.control.gains import Gains as Gains
    from adaptctl.control.gains import sampled_gain as sampled_gain
    from adaptctl.control.gains import typical_inertia as typical_inertia
    from adaptctl.control.guards import Guarded as Guarded
    from adaptctl.control.guards import GuardedState as GuardedState
    from adaptctl.control.lyapunov import lyapunov as lyapunov
    from adaptctl.control.lyapunov import sliding_variable as sliding_variable
    from adaptctl.control.passivity import PassivityBased as PassivityBased
    from adaptctl.control.passivity_integral import PassivityIntegral as PassivityIntegral
    from adaptctl.control.pd_gravity import PDGravity as PDGravity
    from adaptctl.control.references import MinimumJerk as MinimumJerk
    from adaptctl.control.references import Sinusoids as Sinusoids
    from adaptctl.control.references import Spline as Spline
    from adaptctl.control.slotine_li import SlotineLi as SlotineLi
    from adaptctl.control.task_space import TaskSpaceSlotineLi as TaskSpaceSlotineLi
else:
    _HOMES = {
        "adaptation": (
            "AdaptationLaw BoundedGainForgetting Composite CushionedFloor DeadZone EModification Gradient Natural "
            "PriorRanges Projection SigmaModification Subspace adaptation_gain limits mapped_gain"
        ),
        "adaptive": "Adaptive AdaptiveState",
        "adaptive_computed_torque": "AdaptiveComputedTorque",
        "computed_torque": "ComputedTorque",
        "controller": "Controller Reference ReferencePoint",
        "estimates": "load_estimate save_estimate",
        "gains": "Gains sampled_gain typical_inertia",
        "guards": "Guarded GuardedState",
        "lyapunov": "lyapunov sliding_variable",
        "passivity": "PassivityBased",
        "passivity_integral": "PassivityIntegral",
        "pd_gravity": "PDGravity",
        "references": "MinimumJerk Sinusoids Spline",
        "slotine_li": "SlotineLi",
        "task_space": "TaskSpaceSlotineLi",
    }
    __all__, __getattr__, __dir__ = imported_lazily(__name__, _HOMES)
