"""Effect of rounded right angles: the PUMA with pi/2 replaced by a number near it, and the paper's own rule."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Pose
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import EssentialSpace, Priority, essential_space
from adaptctl.identifiability.selection import removable

TIGHT = 1e-8
"""A tolerance that takes what a rounded right angle leaves for independence."""
QUARTERS = {
    "3.1416/2": 3.1416 / 2,
    "3.14159/2": 3.14159 / 2,
    "3.141593/2": 3.141593 / 2,
    "single precision": float(np.float32(np.pi / 2)),
}
"""Right angles (rad) as programs and calculators round them."""
TURNS = (-1, 0, 1, -1, 1, 0)
"""The PUMA's twists, in right angles."""


@dataclass(frozen=True, eq=False)
class RoundedSet:
    """Set of the k of P inertial parameters that the rule of Sheu and Walker (1991, theorem 4.1) keeps: `kept`, their
    indices from 0; `condition`, the condition number of the removed parameters' rows (P - k, P - k) of the null vectors
    V2 (P, P - k), orthonormal directions of parameters that change no energy; and `independent`, the vector D_I (P,) of
    the paper's equation 25, the values of the kept parameters in SI units, zero where removed. Nothing is checked at
    construction."""

    kept: tuple[int, ...]
    condition: float
    """of F2' V2"""
    independent: Array
    """D_I (P,)"""


def with_twists(mechanism: Mechanism, quarter: float) -> Mechanism:
    """Copy of the `mechanism`, a PUMA 560, with changed twists: the angles about x from each joint axis to the next are
    -1, 0 or 1 times `quarter` (rad), such as 1.5708, in place of pi/2. Raises `ValueError` for a `mechanism` of another
    number of links than six."""
    links = tuple(
        replace(link, far=Pose(rotation_about((1, 0, 0), n * quarter), link.far.translation))
        for link, n in zip(mechanism.links, TURNS, strict=True)
    )
    return Mechanism(replace(mechanism.description, links=links))


def with_base_tilt(mechanism: Mechanism, quarter: float) -> Mechanism:
    """Copy of the `mechanism`, a semi-direct-drive arm, with a changed base: the frame of its first joint is turned
    about the world's x axis by minus `quarter` (rad), such as 1.5708, in place of minus pi/2. Nothing is checked."""
    first = mechanism.links[0]
    base = replace(first, near=Pose(rotation_about((1, 0, 0), -quarter), first.near.translation))
    return Mechanism(replace(mechanism.description, links=(base, *mechanism.links[1:])))


def papers_rule(space: EssentialSpace, parameters: Array, priority: Priority) -> RoundedSet:
    """Set of the k of P parameters that the rule of Sheu and Walker (1991, theorem 4.1 and equation 25) keeps, a
    `RoundedSet`. Parameters are considered in the order of `priority`; one is removed where its row of the null vectors
    of `space` (orthonormal directions of parameters that change no energy) is linearly independent of the rows of those
    removed before: its part orthogonal to them has a norm above 1e-8. `parameters` are D (P,), SI units. Raises
    `NotFoundError` for a priority with unknown names, `InputError` for one with a name given twice and for parameters
    of a wrong shape."""
    removed = list(removable(space.null_basis, priority.indices(space.parameter_names), TIGHT))
    kept = tuple(sorted(set(range(len(parameters))) - set(removed)))
    essential, square = space.project(parameters), space.null_basis[removed]
    independent = essential - space.null_basis @ np.linalg.solve(square, essential[removed])
    return RoundedSet(kept, float(np.linalg.cond(square)), independent)


def rounded_set(mechanism: Mechanism, quarter: float, priority: Priority) -> RoundedSet:
    """Set of parameters, a `RoundedSet`, that the rule of Sheu and Walker (1991, theorem 4.1) keeps on the PUMA 560,
    `mechanism`, with `quarter` (rad), such as 1.5708, in place of pi/2; `priority` is the order in which parameters are
    removed. Raises `NotFoundError` for a priority with unknown names, `InputError` for one with a name given twice,
    `ValueError` for a mechanism of another number of links than six, `RankError` where the number of identifiable
    parameters cannot be certified."""
    return papers_rule(essential_space(with_twists(mechanism, quarter)), mechanism.inertial_parameters, priority)
