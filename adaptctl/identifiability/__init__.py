"""Offline: which inertial parameters a motion depends on, and which smallest set is enough."""

from typing import TYPE_CHECKING

from adaptctl.lazily import imported_lazily

if TYPE_CHECKING:
    from adaptctl.identifiability.certificate import Certificate as Certificate
    from adaptctl.identifiability.certificate import Leftover as Leftover
    from adaptctl.identifiability.consistency import Lift as Lift
    from adaptctl.identifiability.consistency import nearest_consistent as nearest_consistent
    from adaptctl.identifiability.constrained import constrained as constrained
    from adaptctl.identifiability.constraints import Constraints as Constraints
    from adaptctl.identifiability.constraints import Relation as Relation
    from adaptctl.identifiability.essential_space import EssentialSpace as EssentialSpace
    from adaptctl.identifiability.essential_space import essential_space as essential_space
    from adaptctl.identifiability.fundamental_basis import FundamentalBasis as FundamentalBasis
    from adaptctl.identifiability.fundamental_basis import fundamental_basis as fundamental_basis
    from adaptctl.identifiability.priority import Priority as Priority
    from adaptctl.identifiability.reduced_model import ReducedModel as ReducedModel
    from adaptctl.identifiability.reduction import Reduction as Reduction
    from adaptctl.identifiability.reduction import reduce as reduce
    from adaptctl.identifiability.right_angles import NearRightAngle as NearRightAngle
    from adaptctl.identifiability.sampling import States as States
    from adaptctl.identifiability.sampling import random_states as random_states
    from adaptctl.identifiability.sampling import states_within_limits as states_within_limits
else:
    _HOMES = {
        "certificate": "Certificate Leftover",
        "consistency": "Lift nearest_consistent",
        "constrained": "constrained",
        "constraints": "Constraints Relation",
        "essential_space": "EssentialSpace essential_space",
        "fundamental_basis": "FundamentalBasis fundamental_basis",
        "priority": "Priority",
        "reduced_model": "ReducedModel",
        "reduction": "Reduction reduce",
        "right_angles": "NearRightAngle",
        "sampling": "States random_states states_within_limits",
    }
    __all__, __getattr__, __dir__ = imported_lazily(__name__, _HOMES)
