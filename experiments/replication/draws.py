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
    """Random draws of an arm's states: the energy differences H of each, factored."""

    arm: SampledArm
    singular_values: Array
    """(seeds, P), of H as it is"""
    reductions: tuple[Reduction, ...]
    """a seed each"""

    @classmethod
    def of(cls, arm: SampledArm, seeds: Sequence[int], samples: int, velocity_scale: float) -> Draws:
        """Draws of `samples` states a seed, as section 5.1 makes one."""
        drawn = [arm.states(np.random.default_rng(seed), samples, velocity_scale) for seed in seeds]
        p, v = (np.stack(parts) for parts in zip(*drawn, strict=True))
        H = np.diff(arm.energies(p, v), axis=1)
        _, values, right = np.linalg.svd(H @ arm.space.basis, full_matrices=False)
        reductions = tuple(_reduction(arm, *factors) for factors in zip(values, right, strict=True))
        return cls(arm, np.asarray(np.linalg.svd(H, compute_uv=False)), reductions)

    @property
    def rank(self) -> int:
        """Certified rank k of the arm."""
        return self.arm.space.rank

    @property
    def percent_errors(self) -> Array:
        """Energy errors (seeds, k + 1) when 0, 1, ..., k components are kept (equation 23)."""
        return np.stack([reduction.percent_errors for reduction in self.reductions])

    @property
    def weights(self) -> Array:
        """Weights |beta_j| (seeds, k) by falling size."""
        return np.abs(np.stack([reduction.weights for reduction in self.reductions]))

    def torque_errors(self, motion: StatedMotion) -> Array:
        """Mean square torque errors (seeds, k + 1, r) along a motion when 0, 1, ..., k components are kept."""
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
        """Torques (T, r), N m, along a motion with the parameters of one seed that keeps some components."""
        return motion.Y @ self.reductions[seed].parameters(components)


def _reduction(arm: SampledArm, values: Array, right: Array) -> Reduction:
    """The reduction for one draw, whose factors among the essential parameters are given."""
    energies = values[:, None] * (right @ arm.space.basis.T)
    drawn = replace(arm.space, energies=lambda: energies, states="a draw of Sheu and Walker's kind")
    return reduce(drawn, arm.parameters, components=arm.space.rank)
