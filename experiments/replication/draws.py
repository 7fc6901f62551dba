"""Random draws of states, many where the paper made one: spectra, energy errors and reduced parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication.arms import SampledArm, StatedMotion
from adaptctl.identifiability import Reduction, reduce


@dataclass(frozen=True, eq=False)
class Draws:
    """Random samples of an arm's states, one for each seed, with the singular values and model reductions that follow.
    H (samples - 1, P) are the energy differences between successive states of one seed, J per SI unit of the P inertial
    parameters. `singular_values` (seeds, P) are those of H in descending order (samples - 1 of them where that is less
    than P). `reductions`, a `Reduction` for each seed, write the parameters of `arm` as a sum of essential components,
    their parts along the right singular vectors of H, in descending order of energy (Sheu and Walker 1991, section 3).
    Nothing is checked at construction."""

    arm: SampledArm
    singular_values: Array
    """(seeds, P), of H as it is"""
    reductions: tuple[Reduction, ...]
    """a seed each"""

    @classmethod
    def of(cls, arm: SampledArm, seeds: Sequence[int], samples: int, velocity_scale: float) -> Draws:
        """Random draws, a `Draws`, of `samples` states of an `arm` for each of the `seeds`, as section 5.1 of Sheu and
        Walker (1991) makes one. `samples` should be above the arm's number P of inertial parameters, which is not
        checked; velocities are uniform up to `velocity_scale` (no unit) times the arm's bound. Raises `RankError` where
        the rank of the arm's inertial parameters cannot be certified."""
        drawn = [arm.states(np.random.default_rng(seed), samples, velocity_scale) for seed in seeds]
        p, v = (np.stack(parts) for parts in zip(*drawn, strict=True))
        H = np.diff(arm.energies(p, v), axis=1)
        _, values, right = np.linalg.svd(H @ arm.space.basis, full_matrices=False)
        reductions = tuple(_reduction(arm, *factors) for factors in zip(values, right, strict=True))
        return cls(arm, np.asarray(np.linalg.svd(H, compute_uv=False)), reductions)

    @property
    def rank(self) -> int:
        """Rank k of the arm's energy regressor: the dimension of its essential space, the directions of its inertial
        parameters that change energies. It is the number of base parameters. Raises `RankError` where it cannot be
        certified."""
        return self.arm.space.rank

    @property
    def percent_errors(self) -> Array:
        """Energy errors (seeds, k + 1) in % when only the first j = 0, 1, ..., k of the k essential components are
        kept, for each random draw. They are 100 |H (D - D_j)| / |H D|: D are the parameters, D_j the sum of their first
        j components, those along the right singular vectors of the energy differences H with the most energy (Sheu and
        Walker 1991, equation 23)."""
        return np.stack([reduction.percent_errors for reduction in self.reductions])

    @property
    def weights(self) -> Array:
        """Energy weights |beta_j| (seeds, k) of the k essential components of the parameters (their parts along the
        right singular vectors of the energy differences), J, in descending order of size: the root of the summed
        squares of the energy differences that each makes (Sheu and Walker 1991, equation 19)."""
        return np.abs(np.stack([reduction.weights for reduction in self.reductions]))

    def torque_errors(self, motion: StatedMotion) -> Array:
        """Mean square torque errors (seeds, k + 1, r), (N m)^2, of the arm's r joints over the times of a `motion`, for
        each random draw. The second axis is for keeping the first 0, 1, ..., k of the k essential components, those
        with the most energy: the parameters' parts along the right singular vectors of the energy differences. Nothing
        is checked."""
        Y = motion.Y
        parts = np.stack([reduction.components for reduction in self.reductions])
        missing = np.cumsum(parts[:, ::-1], axis=1)[:, ::-1]
        # The mean of (Y d)^2 is d' (mean of Y' Y) d: one small matrix a joint instead of every torque of every seed.
        squares = np.einsum("tjp,tjq->jpq", Y, Y, optimize=True) / len(Y)
        errors = np.maximum(np.einsum("...p,jpq,...q->...j", missing, squares, missing, optimize=True), 0.0)
        left = parts.sum(axis=1) - self.arm.parameters
        nothing_missing = np.mean(np.einsum("tjp,sp->stj", Y, left, optimize=True) ** 2, axis=1)
        return np.concatenate([errors, nothing_missing[:, None]], axis=1)

    def torque(self, motion: StatedMotion, seed: int, components: int) -> Array:
        """Torques (T, r), N m, of the arm's r joints at the T times of a `motion`, from the parameters' first
        `components` essential components (their parts along the right singular vectors of the energy differences),
        those with the most energy in one random draw; `seed` is that draw's index, from 0. Raises `InputError` for a
        number of components that is not from 0 to the number k of all, `IndexError` for no such draw."""
        return motion.Y @ self.reductions[seed].parameters(components)


def _reduction(arm: SampledArm, values: Array, right: Array) -> Reduction:
    """The reduction for one draw, whose factors among the essential parameters are given."""
    energies = values[:, None] * (right @ arm.space.basis.T)
    drawn = replace(arm.space, energies=lambda: energies, states="a draw of Sheu and Walker's kind")
    return reduce(drawn, arm.parameters, components=arm.space.rank)
