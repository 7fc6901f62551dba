"""The proof of a rank: when it is worth its time, and where geometry is too near to another to be trusted."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, RankError
from adaptctl.identifiability.methods import Near
from adaptctl.identifiability.proof.exact_energies import ExactEnergies
from adaptctl.identifiability.proof.near_geometry import near_coincidences
from adaptctl.identifiability.proof.simplest import AS_MEANT

LISTED = 3
"""Most near coincidences in a message."""


def proved(mechanism: Mechanism, near: Near, prove: bool | None, seed: int) -> ExactEnergies | None:
    """The energies of a mechanism on exact geometry, an `ExactEnergies`, whose rank proves the mechanism's, or None
    where they are left out.

    They are left out if `prove` is False and, if it is None, for closed loops, which take long, unless some angles or
    lengths are nearly special: angles within 1e-3 rad of a multiple of 90 degrees, or offsets within 1e-4 of the
    characteristic length of zero (in loops also of one another), that are not exact to 1e-11. `seed` draws the states.
    Raises `RankError` where some are nearly special and the rank would be another if they were exactly so, unless
    `near` is "as_is" ("refuse" is the other choice) or `prove` False; `InputError` for another `near`.
    """
    if near not in get_args(Near):
        raise InputError(f"near: expected one of {', '.join(get_args(Near))}, got {near!r}")
    if prove is False:
        return None
    exact = ExactEnergies(mechanism, seed=seed)
    coincidences = near_coincidences(mechanism.description, exact.frames)
    if coincidences:
        exact = replace(exact, strict=True)
    if coincidences and near == "refuse":
        _require_one_rank(mechanism, exact, coincidences)
    return exact if prove or not exact.closed or coincidences else None


def _require_one_rank(mechanism: Mechanism, exact: ExactEnergies, coincidences: tuple[str, ...]) -> None:
    meant = _rank(ExactEnergies(mechanism, AS_MEANT, exact.seed))
    if meant == exact.rank:
        return
    more = f"; and {len(coincidences) - LISTED} more" if len(coincidences) > LISTED else ""
    if_meant = f"{meant} if" if meant is not None else "not to be told where"
    raise RankError(
        f"{mechanism.name}: the rank is {exact.rank} as the geometry stands, and {if_meant} what is nearly special is "
        f"meant to be so: {'; '.join(coincidences[:LISTED])}{more}. Write what is meant exactly, or load with "
        'snap=True, which makes angles right; if it is meant as it stands, say near="as_is"'
    )


def _rank(energies: ExactEnergies) -> int | None:
    """The rank; None where the geometry that may be meant does not close its loops."""
    try:
        return energies.rank
    except ArithmeticError:
        return None
