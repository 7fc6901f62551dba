"""Joint positions for which gains are checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, checked, finite_number, frozen, random_seed, whole_number
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind

MAX_RANGE = 4.0 * np.pi  # rad (m): limits more than two turns apart count as none
SEARCH_STARTS, SEARCH_STARTS_WITH_LOOPS, SEARCH_ROUNDS, RANDOM_MOVES = 6, 2, 14, 12
MAX_SAMPLES = 1_000_000
MAX_MOVE = 0.25  # of each joint's range, in the first round
MIN_START_DISTANCE = 0.2  # of some joint's range, between two starts


def sampled_configurations(mechanism: Mechanism, samples: int = 200, seed: int = 0) -> Array:
    """Random positions (S, r) where loops close."""
    p = np.random.default_rng(seed).uniform(*position_range(mechanism), (samples, mechanism.dof))
    p = p[reachable(mechanism, p)]
    if not len(p):
        raise InputError(
            f"workspace: {mechanism.name} reaches none of {samples} random positions within its joint limits: give "
            "more samples, or limits within which its loops close"
        )
    return p


def position_range(mechanism: Mechanism) -> tuple[Array, Array]:
    """Lower and upper positions (r,), about a turn where limits are missing."""
    lower, upper = _limits(mechanism)
    wide = np.array([np.pi if joint.kind.is_revolute else 1.0 for joint in mechanism.primary_joints])
    return np.where(np.isinf(lower), np.minimum(-wide, upper - wide), lower), np.where(
        np.isinf(upper), np.maximum(wide, lower + wide), upper
    )


def _limits(mechanism: Mechanism) -> Array:
    """Limits (2, r), infinite where missing or too far apart."""
    limits = [joint.limits for joint in mechanism.primary_joints]
    ends = np.array([(b.lower, b.upper) for b in limits]).reshape(-1, 2).T
    absurd = np.isfinite(ends).all(axis=0) & (ends[1] - ends[0] > MAX_RANGE)
    return np.where(absurd, [[-np.inf], [np.inf]], ends)


def reachable(mechanism: Mechanism, p: Array) -> NDArray[np.bool_]:
    """Mask (samples,) of positions where loops close."""
    if mechanism.continuation is None:
        return np.ones(len(p), dtype=np.bool_)
    allowed = np.asarray(mechanism.description.within_conditions(p))
    allowed[allowed] = mechanism.continuation.reachable(p[allowed])
    return allowed


class Worst(NamedTuple):
    """Extreme value of a function, and its positions (r,)."""

    value: float
    p: Array


@dataclass(frozen=True, eq=False)
class Workspace:
    """
    Joint positions for which gains are checked: samples, with a box around each for searches.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    samples : ndarray
        Positions (S, r) in rad (m).
    lower, upper : ndarray
        Bounds (S, r) of a search from each sample in rad (m).

    Examples
    --------
    >>> workspace = adaptctl.control.Workspace.along(arm, reference(np.linspace(0.0, 4.0, 20)).p, margin=0.1)
    >>> adaptctl.SlotineLi(model, 5.0, [6.0, 2.0], workspace=workspace).workspace.samples.shape
    (20, 2)
    """

    mechanism: Mechanism
    samples: Array
    lower: Array
    upper: Array

    def __repr__(self) -> str:
        return f"<Workspace of {self.mechanism.name!r}: {len(self.samples)} samples>"

    @classmethod
    def within_limits(cls, mechanism: Mechanism, samples: int = 200, seed: int = 0) -> Workspace:
        """
        Return random positions within the joints' limits.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r joints.
        samples : int, default 200
            Number of samples, up to 1,000,000, less those where kinematic loops cannot be closed.
        seed : int, default 0
            Seed of the samples. Fixed, so that gains can be repeated.

        Returns
        -------
        Workspace
            Samples within the limits; a missing limit is pi rad (1 m) beyond zero and the other limit.

        Raises
        ------
        InputError
            If a number is out of range, or loops can be closed at none of the samples.

        Examples
        --------
        >>> adaptctl.control.Workspace.within_limits(arm, samples=50).samples.shape
        (50, 2)
        """
        validate_kind(mechanism, Mechanism, "workspace", "as load(...) gives one")
        samples = whole_number(samples, "workspace: samples", 1, MAX_SAMPLES)
        seed = random_seed(seed, "workspace: seed")
        p = sampled_configurations(mechanism, samples, seed)
        turns = [joint.kind.is_revolute for joint in mechanism.primary_joints]
        below, above = np.pi * (np.isinf(_limits(mechanism)) & turns)
        lower, upper = position_range(mechanism)
        return cls(mechanism, p, np.broadcast_to(lower - below, p.shape), np.broadcast_to(upper + above, p.shape))

    @classmethod
    def along(cls, mechanism: Mechanism, p: ArrayLike, margin: float = 0.2) -> Workspace:
        """
        Return the joint positions near a reference trajectory.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r joints.
        p : array_like
            Positions (S, r) of the reference in rad (m), of which those where loops cannot be closed are left out.
        margin : float, default 0.2
            Largest distance in rad (m) from a sample in each joint. The default is twice the initial error of `tune`.

        Returns
        -------
        Workspace
            Samples on the reference, so that singularities elsewhere do not limit gains.

        Raises
        ------
        InputError
            If the margin is negative, the shape wrong, or loops can be closed nowhere.
        NonFiniteError
            If a position is not finite.

        Examples
        --------
        >>> times = np.linspace(0.0, 2.0, 20)
        >>> adaptctl.control.Workspace.along(arm, np.array([reference(t).p for t in times])).samples.shape
        (20, 2)
        """
        margin = finite_number(margin, "workspace: margin")
        path = np.atleast_2d(checked(p, mechanism.dof, "workspace: positions"))
        path = path[reachable(mechanism, path)]
        if not len(path):
            raise InputError(f"workspace: {mechanism.name} reaches none of the given positions")
        return cls(mechanism, path, path - margin, path + margin)

    @cached_property
    def mass_matrices(self) -> Array:
        """Mass matrices (S, r, r) at the samples."""
        return frozen(self.mechanism.mass_matrix(self.samples))

    def maximum(self, value: Callable[[Array], Array]) -> Worst:
        """
        Find the greatest value of a function by a pattern search.

        Parameters
        ----------
        value : callable
            Function from positions (N, r) in rad (m) to numbers (N,).

        Returns
        -------
        Worst
            Greatest value and positions, by a search that starts at samples; these alone often give less than 90 %.

        Examples
        --------
        >>> workspace = adaptctl.control.Workspace.within_limits(arm)
        >>> workspace.maximum(lambda p: np.cos(p[:, 0])).value > 0.99
        True
        """
        found = value(self.samples)
        start = self._starts(np.argsort(found)[::-1])
        lower, upper, p, best = self.lower[start], self.upper[start], self.samples[start], found[start]
        step, moves, each = MAX_MOVE * (upper - lower), self._moves, np.arange(len(start))
        for _ in range(SEARCH_ROUNDS):
            if np.isinf(best).any() or not step.any():  # there is nothing greater, or nowhere to go
                break
            near = np.clip(p[:, None] + moves * step[:, None], lower[:, None], upper[:, None])
            reached = self._values(value, near.reshape(-1, p.shape[1])).reshape(near.shape[:2])
            chosen = reached.argmax(axis=1)
            better = reached[each, chosen] > best
            p = np.where(better[:, None], near[each, chosen], p)
            best = np.where(better, reached[each, chosen], best)
            step = np.where(better[:, None], step, 0.4 * step)
        worst = int(best.argmax())
        return Worst(float(best[worst]), frozen(p[worst].copy()))

    def _starts(self, order: NDArray[np.intp]) -> NDArray[np.intp]:
        """First samples of an order that are apart."""
        most = SEARCH_STARTS if self.mechanism.continuation is None else SEARCH_STARTS_WITH_LOOPS
        scale = np.maximum(np.ptp(self.samples, axis=0), 1e-12)
        chosen, near = [order[0]], list[np.intp]()
        for k in order[1:]:
            away = np.abs(self.samples[chosen] - self.samples[k]) / scale
            (chosen if np.all(away.max(axis=1) > MIN_START_DISTANCE) else near).append(k)
            if len(chosen) == most:
                break
        return np.array((chosen + near)[:most])

    def _values(self, value: Callable[[Array], Array], p: Array) -> Array:
        """Values, minus infinity without closed loops."""
        reached = np.full(len(p), -np.inf)
        allowed = reachable(self.mechanism, p)
        reached[allowed] = value(p[allowed])
        return reached

    @cached_property
    def _moves(self) -> Array:
        """Moves (m, r): single joints and random directions."""
        unit = np.eye(self.mechanism.dof)
        together = np.random.default_rng(0).normal(size=(RANDOM_MOVES, self.mechanism.dof))
        together /= np.linalg.norm(together, axis=1, keepdims=True)
        return np.concatenate((unit, -unit, together))


@lru_cache(maxsize=8)
def everywhere(mechanism: Mechanism) -> Workspace:
    """Workspace of all positions within the limits."""
    return Workspace.within_limits(mechanism)


def workspace_of(mechanism: Mechanism, workspace: Workspace | None) -> Workspace:
    """Given workspace with this mechanism's masses, or `everywhere`."""
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
