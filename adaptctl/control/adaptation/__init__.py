"""Adaptation laws: how estimates move, whatever control law uses them."""

from typing import TYPE_CHECKING

from adaptctl.lazily import imported_lazily

if TYPE_CHECKING:
    from adaptctl.control.adaptation.bounded_gain_forgetting import BoundedGainForgetting as BoundedGainForgetting
    from adaptctl.control.adaptation.composite import Composite as Composite
    from adaptctl.control.adaptation.cushioned_floor import CushionedFloor as CushionedFloor
    from adaptctl.control.adaptation.dead_zone import DeadZone as DeadZone
    from adaptctl.control.adaptation.gradient import Gradient as Gradient
    from adaptctl.control.adaptation.law import AdaptationLaw as AdaptationLaw
    from adaptctl.control.adaptation.law import Period as Period
    from adaptctl.control.adaptation.leakage import EModification as EModification
    from adaptctl.control.adaptation.leakage import SigmaModification as SigmaModification
    from adaptctl.control.adaptation.natural import Natural as Natural
    from adaptctl.control.adaptation.prior_ranges import PriorRanges as PriorRanges
    from adaptctl.control.adaptation.prior_ranges import adaptation_gain as adaptation_gain
    from adaptctl.control.adaptation.prior_ranges import mapped_gain as mapped_gain
    from adaptctl.control.adaptation.projection import Projection as Projection
    from adaptctl.control.adaptation.projection import limits as limits
    from adaptctl.control.adaptation.subspace import Subspace as Subspace
else:
    _HOMES = {
        "bounded_gain_forgetting": "BoundedGainForgetting",
        "composite": "Composite",
        "cushioned_floor": "CushionedFloor",
        "dead_zone": "DeadZone",
        "gradient": "Gradient",
        "law": "AdaptationLaw Period",
        "leakage": "EModification SigmaModification",
        "natural": "Natural",
        "prior_ranges": "PriorRanges adaptation_gain mapped_gain",
        "projection": "Projection limits",
        "subspace": "Subspace",
    }
    __all__, __getattr__, __dir__ = imported_lazily(__name__, _HOMES)
