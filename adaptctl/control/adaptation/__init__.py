"""Adaptation laws: how estimates move, whatever control law uses them."""

from adaptctl.control.adaptation.bounded_gain_forgetting import BoundedGainForgetting
from adaptctl.control.adaptation.composite import Composite
from adaptctl.control.adaptation.cushioned_floor import CushionedFloor
from adaptctl.control.adaptation.dead_zone import DeadZone
from adaptctl.control.adaptation.gradient import Gradient
from adaptctl.control.adaptation.law import AdaptationLaw, Period
from adaptctl.control.adaptation.leakage import EModification, SigmaModification
from adaptctl.control.adaptation.natural import Natural
from adaptctl.control.adaptation.prior_ranges import PriorRanges, adaptation_gain, mapped_gain
from adaptctl.control.adaptation.projection import Projection, limits
from adaptctl.control.adaptation.subspace import Subspace

__all__ = [
    "AdaptationLaw",
    "BoundedGainForgetting",
    "Composite",
    "CushionedFloor",
    "DeadZone",
    "EModification",
    "Gradient",
    "Natural",
    "Period",
    "PriorRanges",
    "Projection",
    "SigmaModification",
    "Subspace",
    "adaptation_gain",
    "limits",
    "mapped_gain",
]
