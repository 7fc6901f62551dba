"""Configurations at which gains are to hold, and the search for the worst of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, checked, frozen, real_number, whole_number
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind

TURNS = 4.0 * np.pi
"""rad (m): limits farther apart than two turns are none"""
STARTS, STARTS_WITH_LOOPS, ROUNDS, RANDOM_MOVES = 6, 2, 14, 12
MOST_SAMPLES = 1_000_000
LARGEST_MOVE = 0.25
"""of the range of each joint, in the first round"""
APART = 0.2
"""of the range of some joint, from one start to the other"""


def sampled_configurations(mechanism: Mechanism, samples: int = 200, seed: int = 0) -> Array:
    """Random positions (S, r) of the `mechanism`'s r joints within their limits, rad (m if prismatic). `samples` of
    them, 200 by default, are drawn uniformly by `seed`, 0 by default; those where kinematic loops cannot be closed are
    left out, so that S remain. A missing lower limit counts as the lesser of -pi rad (-1 m) and the upper one less pi
    rad (1 m), a missing upper one as the greater of pi rad (1 m) and the lower one plus pi rad (1 m), and limits more
    than 4 pi rad (m) apart as missing. Equal seeds draw equal positions. Raises `InputError` where loops can be closed
    at none of them; `samples`, at least 1, and `seed` are not checked."""
    p = np.random.default_rng(seed).uniform(*position_range(mechanism), (samples, mechanism.dof))
    p = p[reachable(mechanism, p)]
    if not len(p):
        raise InputError(
            f"workspace: {mechanism.name} reaches none of {samples} random positions within its joints' limits: draw "
            "more, or state limits within which its loops close"
        )
    return p


def position_range(mechanism: Mechanism) -> tuple[Array, Array]:
    """The least and the greatest position of each of the r joints of a `mechanism`, two arrays (r,), rad (m if
    prismatic): its limits. A missing lower one is min(-pi, upper - pi) rad (min(-1, upper - 1) m), a missing upper one
    max(pi, lower + pi) rad (max(1, lower + 1) m), so that a joint without limits has -pi and pi rad (-1 and 1 m).
    Limits that are more than 4 pi rad (m) apart count as missing. Nothing is checked."""
    lower, upper = _limits(mechanism)
    wide = np.array([np.pi if joint.kind.is_revolute else 1.0 for joint in mechanism.primary_joints])
    return np.where(np.isinf(lower), np.minimum(-wide, upper - wide), lower), np.where(
        np.isinf(upper), np.maximum(wide, lower + wide), upper
    )


def _limits(mechanism: Mechanism) -> Array:
    """Lower and upper limits (2, r) of the joints, infinite where there is none or they are too far apart to be any."""
    limits = [joint.limits for joint in mechanism.primary_joints]
    ends = np.array([(b.lower, b.upper) for b in limits]).reshape(-1, 2).T
    absurd = np.isfinite(ends).all(axis=0) & (ends[1] - ends[0] > TURNS)
    return np.where(absurd, [[-np.inf], [np.inf]], ends)


def reachable(mechanism: Mechanism, p: Array) -> NDArray[np.bool_]:
    """Mask (samples,) of bools: True where the mechanism's kinematic loops can be closed at positions p (samples, r) of
    its r primary (independent) joints, rad (m if prismatic). They can if the straight path to p from the mechanism's
    reference configuration comes to no singularity, and p is within the bounds on weighted sums of joint positions that
    the mechanism's description states. It is True everywhere without loops. Shapes and numbers of p are not checked."""
    if mechanism.continuation is None:
        return np.ones(len(p), dtype=np.bool_)
    allowed = np.asarray(mechanism.description.within_conditions(p))
    allowed[allowed] = mechanism.continuation.reachable(p[allowed])
    return allowed


class Worst(NamedTuple):
    """Record of the extreme value of a function that a search over joint positions found: `value`, in the unit of the
    function, and the positions `p` (r,) of the r joints, rad (m if prismatic), where it is. It is the greatest value,
    or the least where the function that returns it says so. Nothing is checked."""

    value: float
    p: Array


@dataclass(frozen=True, eq=False)
class Workspace:
    """Set of joint positions of a `mechanism` of r joints, given by samples and a box about each, over which the worst
    case of gains is sought. `samples` (S, r) are S positions; `lower` and `upper` (S, r) are the bounds within which a
    search that starts at each sample stays; all in rad (m if prismatic). Nothing is checked."""

    mechanism: Mechanism
    samples: Array
    lower: Array
    upper: Array

    @classmethod
    def within_limits(cls, mechanism: Mechanism, samples: int = 200, seed: int = 0) -> Workspace:
        """Set of all joint positions that the limits of a `mechanism` of r joints allow, a `Workspace`, sampled at
        random. `samples` positions, 200 by default, are drawn uniformly by `seed`, 0 by default, equal for equal seeds;
        those at which kinematic loops cannot be closed are left out.

        Samples are within [low, high] of each joint: its limits, in rad (m if prismatic), of which a missing low is
        min(-pi, high - pi) rad (min(-1, high - 1) m) and a missing high max(pi, low + pi) rad (max(1, low + 1) m).
        Limits more than 4 pi rad (m) apart count as missing. A search, such as that of the method `highest`, may leave
        a sample for any position in [low, high], which for a revolute joint is widened by pi rad on each side without a
        limit, so that it does not stop at the end of the sampled turn.

        Raises `InputError` unless `samples` is a whole number from 1 to 1,000,000 and `seed` one from 0 to 2^32 - 1,
        and where loops can be closed at none of the samples.
        """
        validate_kind(mechanism, Mechanism, "workspace", "as load(...) gives one")
        samples = whole_number(samples, "workspace: samples", 1, MOST_SAMPLES)
        seed = whole_number(seed, "workspace: seed", 0, 2**32 - 1)
        p = sampled_configurations(mechanism, samples, seed)
        turns = [joint.kind.is_revolute for joint in mechanism.primary_joints]
        below, above = np.pi * (np.isinf(_limits(mechanism)) & turns)
        lower, upper = position_range(mechanism)
        return cls(mechanism, p, np.broadcast_to(lower - below, p.shape), np.broadcast_to(upper + above, p.shape))

    @classmethod
    def along(cls, mechanism: Mechanism, p: ArrayLike, margin: float = 0.2) -> Workspace:
        """Set of joint positions near a reference, a `Workspace`: its samples are S positions `p` (S, r) on the
        reference, in rad (m if prismatic), and a search stays within `margin` rad (m), 0.2 by default, of a sample in
        each of the r joints of the `mechanism`. Positions at which kinematic loops cannot be closed are left out.

        Gains that would be too large near a singularity of the wrist or with the arm folded are accepted where the
        reference keeps clear of these. Raises `InputError` for a margin that is negative or not finite and for a wrong
        shape, and where loops can be closed at none of the positions, `NonFiniteError` for positions that are not
        finite.
        """
        if not 0.0 <= real_number(margin, "workspace: margin") < np.inf:
            raise InputError(f"workspace: margin: expected at least 0 rad, got {margin}")
        path = np.atleast_2d(checked(p, mechanism.dof, "workspace: positions"))
        path = path[reachable(mechanism, path)]
        if not len(path):
            raise InputError(f"workspace: {mechanism.name} reaches none of the positions given")
        return cls(mechanism, path, path - margin, path + margin)

    @cached_property
    def mass_matrices(self) -> Array:
        """Mass matrices M (S, r, r) at the S samples of this set of positions of r joints, in kg m^2 (kg between
        prismatic joints). They are computed once, since with kinematic loops they take seconds. Raises
        `SingularityError` near a singularity of the loops."""
        return frozen(self.mechanism.mass_matrix(self.samples))

    def maximum(self, value: Callable[[Array], Array]) -> Worst:
        """The greatest value of the function `value` that a pattern search over this set of joint positions finds, a
        `Worst`: this value and the positions `p` (r,) of the r joints, rad (m if prismatic), where it is. The function
        maps N positions (N, r), rad (m), to N numbers (N,), finite or infinite. What it raises goes through; nothing
        else is checked.

        The search starts at 6 samples (2 with kinematic loops) of greatest value, where possible apart by more than a
        fifth of some joint's range, and takes up to 14 rounds of steps, each joint by itself and 12 random directions,
        within the bounds of these samples. The samples alone do not tell: take the greatest eigenvalue of M^-1 K, M the
        mass matrix and K the damping. The largest of some hundred samples is nine tenths of the maximum in the median
        case, and less than half of it for an arm whose wrist folds.
        """
        found = value(self.samples)
        start = self._apart(np.argsort(found)[::-1])
        lower, upper, p, best = self.lower[start], self.upper[start], self.samples[start], found[start]
        step, moves, each = LARGEST_MOVE * (upper - lower), self._moves, np.arange(len(start))
        for _ in range(ROUNDS):
            if np.isinf(best).any() or not step.any():  # there is nothing greater, or nowhere to go
                break
            near = np.clip(p[:, None] + moves * step[:, None], lower[:, None], upper[:, None])
            reached = self._valued(value, near.reshape(-1, p.shape[1])).reshape(near.shape[:2])
            chosen = reached.argmax(axis=1)
            better = reached[each, chosen] > best
            p = np.where(better[:, None], near[each, chosen], p)
            best = np.where(better, reached[each, chosen], best)
            step = np.where(better[:, None], step, 0.4 * step)
        worst = int(best.argmax())
        return Worst(float(best[worst]), frozen(p[worst].copy()))

    def _apart(self, order: NDArray[np.intp]) -> NDArray[np.intp]:
        """The first few in an order of samples that lie apart, as far as there are such."""
        most = STARTS if self.mechanism.continuation is None else STARTS_WITH_LOOPS
        scale = np.maximum(np.ptp(self.samples, axis=0), 1e-12)
        chosen, near = [order[0]], list[np.intp]()
        for k in order[1:]:
            away = np.abs(self.samples[chosen] - self.samples[k]) / scale
            (chosen if np.all(away.max(axis=1) > APART) else near).append(k)
            if len(chosen) == most:
                break
        return np.array((chosen + near)[:most])

    def _valued(self, value: Callable[[Array], Array], p: Array) -> Array:
        """Values of positions, minus infinity where loops cannot be."""
        reached = np.full(len(p), -np.inf)
        allowed = reachable(self.mechanism, p)
        reached[allowed] = value(p[allowed])
        return reached

    @cached_property
    def _moves(self) -> Array:
        """Moves (m, r): each joint to either side, by a whole step and by a part, and some of all joints together."""
        unit = np.eye(self.mechanism.dof)
        together = np.random.default_rng(0).normal(size=(RANDOM_MOVES, self.mechanism.dof))
        together /= np.linalg.norm(together, axis=1, keepdims=True)
        return np.concatenate((unit, -unit, together))


@lru_cache(maxsize=8)
def everywhere(mechanism: Mechanism) -> Workspace:
    """Set of all joint positions that the limits of a `mechanism` of r joints allow, a `Workspace`, in 200 random
    samples, the same in every call, less those at which kinematic loops cannot be closed. The sets of the last 8
    mechanisms are kept, so that the next call returns the same object at once. Raises `InputError` where loops can be
    closed at none of the samples."""
    return Workspace.within_limits(mechanism)


def workspace_of(mechanism: Mechanism, workspace: Workspace | None) -> Workspace:
    """The workspace in which a mechanism is judged: all that its joints' limits allow for a `workspace` of None, else
    the given one, with the masses of this mechanism where it was made for another, such as a rough model of it. Raises
    `InputError` for a `workspace` that is no `Workspace` or of another number of joints."""
    if workspace is None:
        return everywhere(mechanism)
    validate_kind(workspace, Workspace, "workspace", "as Workspace.within_limits(mechanism) gives one")
    if workspace.mechanism is mechanism:
        return workspace
    if (joints := workspace.samples.shape[-1]) != mechanism.dof:
        raise InputError(f"workspace: expected one of {mechanism.dof} joints, as {mechanism.name} has, got {joints}")
    return _with_masses(workspace, mechanism)


@lru_cache(maxsize=8)
def _with_masses(workspace: Workspace, mechanism: Mechanism) -> Workspace:
    return replace(workspace, mechanism=mechanism)
