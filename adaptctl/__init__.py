"""Adaptive control of robot mechanisms on their fundamental inertial parameters.

The public names are imported when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from adaptctl.control import (
        ComputedTorque,
        Gains,
        MinimumJerk,
        PriorRanges,
        Sinusoids,
        SlotineLi,
        Spline,
        adaptation_gain,
        lyapunov,
    )
    from adaptctl.dynamics import Mechanism, load
    from adaptctl.errors import AdaptctlError, FileError, InputError, NotFoundError, RankError
    from adaptctl.identifiability import (
        EssentialSpace,
        FundamentalBasis,
        Priority,
        ReducedModel,
        Reduction,
        essential_space,
        fundamental_basis,
        reduce,
    )
    from adaptctl.simulation import Plant, Rollout, rollout, simulate, simulate_many

    __version__: str

__all__ = [
    "AdaptctlError",
    "ComputedTorque",
    "EssentialSpace",
    "FileError",
    "FundamentalBasis",
    "Gains",
    "InputError",
    "Mechanism",
    "MinimumJerk",
    "NotFoundError",
    "Plant",
    "PriorRanges",
    "Priority",
    "RankError",
    "ReducedModel",
    "Reduction",
    "Rollout",
    "Sinusoids",
    "SlotineLi",
    "Spline",
    "__version__",
    "adaptation_gain",
    "essential_space",
    "fundamental_basis",
    "load",
    "lyapunov",
    "reduce",
    "rollout",
    "simulate",
    "simulate_many",
]

_HOMES = {
    "adaptctl.control": (
        "ComputedTorque",
        "Gains",
        "MinimumJerk",
        "PriorRanges",
        "Sinusoids",
        "SlotineLi",
        "Spline",
        "adaptation_gain",
        "lyapunov",
    ),
    "adaptctl.dynamics": ("Mechanism", "load"),
    "adaptctl.errors": ("AdaptctlError", "FileError", "InputError", "NotFoundError", "RankError"),
    "adaptctl.identifiability": (
        "EssentialSpace",
        "FundamentalBasis",
        "Priority",
        "ReducedModel",
        "Reduction",
        "essential_space",
        "fundamental_basis",
        "reduce",
    ),
    "adaptctl.simulation": ("Plant", "Rollout", "rollout", "simulate", "simulate_many"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name from its home (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import version

        found: Any = version("adaptctl")
    elif name in _HOME_OF:
        from importlib import import_module

        found = getattr(import_module(_HOME_OF[name]), name)
    else:
        raise AttributeError(f"module 'adaptctl' has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
