"""Random positions of a mechanism with loops: only along continuation from the reference, on its branch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError

REGULAR = 0.2
"""Fraction of its reference value that the loops' smallest singular value keeps: nearer to a singularity, dependent
joints race and drown the rest of the spectrum."""

POINTS = 65
"""Points along a line at which conditions are checked."""

MOST_DRAWS = 100
"""Most draws before positions are refused."""
FEWEST = 100
"""Fewest positions in one draw: following a few takes as long."""


def positions_on_branch(mechanism: Mechanism, positions: Array, generator: np.random.Generator) -> Array:
    """Positions (n, r) of n samples, rad (m for a prismatic joint), of a mechanism's r primary (independent) joints, at
    which its closed loops can be closed, from random `positions` (n, r). Those of joints that move a loop are brought
    onto the assembly branch of the reference configuration; a mechanism without loops keeps all.

    Of the m joints that move a loop, `positions` are offsets from the reference configuration. They go from it along
    the straight line to that offset, clipped to their limits, as far as the mechanism's conditions (bounds on weighted
    sums of its positions) hold and the closure Jacobian's smallest singular value is at least 0.2 of that at the
    reference configuration. They stop at a fraction u^(1/m) of this line, with u uniform in 0..1, drawn for each sample
    with NumPy's `generator`. Joints that move no loop keep their positions. Raises `InputError` for a reference that
    breaks a condition, `LoopError` where loops cannot be closed.
    """
    continuation = mechanism.continuation
    if continuation is None:
        return positions
    looped = np.array(continuation.equations.closing.looped)
    start = continuation.reference[continuation.primary]
    wanted = np.where(looped, _within_limits(mechanism, start + positions), start)
    way = (wanted - start) * _within_conditions(mechanism, start, wanted)[:, None]
    way *= continuation.progress(start + way, REGULAR)[:, None]
    way *= generator.uniform(size=(len(way), 1)) ** (1.0 / max(int(looped.sum()), 1))
    return np.where(looped, start + way, positions)


def reachable_positions(mechanism: Mechanism, samples: int, draw: Callable[[int], Array]) -> Array:
    """The first `samples` positions (samples, r), rad (m for a prismatic joint), of a mechanism's r primary
    (independent) joints, out of those that the function `draw` gives, at which its closed loops can be closed. A
    mechanism without loops takes all that are drawn.

    `draw`, called with a number n, gives n random positions (n, r). Those are taken that keep the mechanism's
    conditions (bounds on weighted sums of its positions) and, loops closed, the limits of all the tree's joints, and to
    which a straight line from the reference leads on which the closure Jacobian's smallest singular value is at least
    0.2 of that at the reference configuration. Raises `InputError` when a hundred draws, of at least 100 positions
    each, do not give enough, `LoopError` where loops cannot be closed.
    """
    continuation = mechanism.continuation
    if continuation is None:
        return draw(samples)
    kept = np.empty((0, mechanism.dof))
    batch = max(samples, FEWEST)
    for _ in range(MOST_DRAWS):
        p = draw(batch)
        p = p[mechanism.description.within_conditions(p)]
        p = p[continuation.progress(p, REGULAR) >= 1.0]
        kept = np.concatenate([kept, p[_tree_within_limits(mechanism, continuation.follow(p))]])
        if len(kept) >= samples:
            return kept[:samples]
    raise InputError(
        f"{mechanism.name}: of {MOST_DRAWS * batch} positions within the primary joints' limits only {len(kept)} keep "
        "the conditions and let the loops close; narrow the limits, or add conditions that leave out the rest"
    )


def _tree_within_limits(mechanism: Mechanism, q: Array) -> NDArray[np.bool_]:
    limits = [link.joint.limits for link in mechanism.links]
    lower, upper = ([getattr(bounds, which) for bounds in limits] for which in ("lower", "upper"))
    inside: NDArray[np.bool_] = np.all((q >= lower) & (q <= upper), axis=-1)
    return inside


def _within_limits(mechanism: Mechanism, p: Array) -> Array:
    limits = [joint.limits for joint in mechanism.primary_joints]
    return np.clip(p, [bounds.lower for bounds in limits], [bounds.upper for bounds in limits])


def _within_conditions(mechanism: Mechanism, start: Array, wanted: Array) -> Array:
    """Shares (m,) of the straight ways along which the mechanism's conditions hold."""
    description = mechanism.description
    if not description.within_conditions(start):
        raise InputError(
            f"{mechanism.name}: the reference configuration, p = {np.round(start, 4).tolist()}, breaks a condition of "
            "the mechanism: give a reference within it"
        )
    shares = np.linspace(0.0, 1.0, POINTS)
    inside = description.within_conditions(start + shares[:, None, None] * (wanted - start))
    return shares[np.logical_and.accumulate(inside).sum(axis=0) - 1]
