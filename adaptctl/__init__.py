"""Adaptive control of robot mechanisms on their fundamental inertial parameters.

The public names are imported when they are first used, so that importing the package costs nothing.
"""

from typing import TYPE_CHECKING

from adaptctl.lazily import imported_lazily

if TYPE_CHECKING:
    from adaptctl.control import ComputedTorque as ComputedTorque
    from adaptctl.control import Gains as Gains
    from adaptctl.control import MinimumJerk as MinimumJerk
    from adaptctl.control import PriorRanges as PriorRanges
    from adaptctl.control import Sinusoids as Sinusoids
    from adaptctl.control import SlotineLi as SlotineLi
    from adaptctl.control import Spline as Spline
    from adaptctl.control import adaptation_gain as adaptation_gain
    from adaptctl.control import lyapunov as lyapunov
    from adaptctl.dynamics import Mechanism as Mechanism
    from adaptctl.dynamics import load as load
    from adaptctl.errors import AdaptctlError as AdaptctlError
    from adaptctl.errors import FileError as FileError
    from adaptctl.errors import InputError as InputError
    from adaptctl.errors import NotFoundError as NotFoundError
    from adaptctl.errors import RankError as RankError
    from adaptctl.identifiability import EssentialSpace as EssentialSpace
    from adaptctl.identifiability import FundamentalBasis as FundamentalBasis
    from adaptctl.identifiability import Priority as Priority
    from adaptctl.identifiability import ReducedModel as ReducedModel
    from adaptctl.identifiability import Reduction as Reduction
    from adaptctl.identifiability import essential_space as essential_space
    from adaptctl.identifiability import fundamental_basis as fundamental_basis
    from adaptctl.identifiability import reduce as reduce
    from adaptctl.simulation import Plant as Plant
    from adaptctl.simulation import Rollout as Rollout
    from adaptctl.simulation import rollout as rollout
    from adaptctl.simulation import simulate as simulate
    from adaptctl.simulation import simulate_many as simulate_many
    from adaptctl.version import __version__ as __version__
else:
    _HOMES = {
        "control": "ComputedTorque Gains MinimumJerk PriorRanges Sinusoids SlotineLi Spline adaptation_gain lyapunov",
        "dynamics": "Mechanism load",
        "errors": "AdaptctlError FileError InputError NotFoundError RankError",
        "identifiability": (
            "EssentialSpace FundamentalBasis Priority ReducedModel Reduction essential_space fundamental_basis reduce"
        ),
        "simulation": "Plant Rollout rollout simulate simulate_many",
        "version": "__version__",
    }
    __all__, __getattr__, __dir__ = imported_lazily(__name__, _HOMES)
