"""Offline: which inertial parameters a motion depends on, and which smallest set is enough."""

from adaptctl.identifiability.certificate import Certificate, Leftover
from adaptctl.identifiability.consistency import Lift, nearest_consistent
from adaptctl.identifiability.constrained import constrained
from adaptctl.identifiability.constraints import Constraints, Relation
from adaptctl.identifiability.essential_space import EssentialSpace, essential_space
from adaptctl.identifiability.fundamental_basis import FundamentalBasis, fundamental_basis
from adaptctl.identifiability.priority import Priority
from adaptctl.identifiability.reduced_model import ReducedModel
from adaptctl.identifiability.reduction import Reduction, reduce
from adaptctl.identifiability.right_angles import NearRightAngle
from adaptctl.identifiability.sampling import States, random_states, states_within_limits

__all__ = [
    "Certificate",
    "Constraints",
    "EssentialSpace",
    "FundamentalBasis",
    "Leftover",
    "Lift",
    "NearRightAngle",
    "Priority",
    "ReducedModel",
    "Reduction",
    "Relation",
    "States",
    "constrained",
    "essential_space",
    "fundamental_basis",
    "nearest_consistent",
    "random_states",
    "reduce",
    "states_within_limits",
]
