"""Persistent excitation, measured: how much a motion tells of the parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, per_joint, real_number
from adaptctl.compilation import compile_function
from adaptctl.compilation.kernel import LARGEST_COMPILED
from adaptctl.control.adaptation import PriorRanges
from adaptctl.control.lyapunov import SampledRun
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column

DOUBLINGS = 4
BLOCKS = 2**DOUBLINGS
"""Number of blocks that a window is divided into; it moves by one."""


@dataclass(frozen=True, eq=False)
class Excitation:
    """Extreme eigenvalues of the excitation Gram matrix, the integral of (Y S)'(Y S) over time, in each of w windows
    along a run. A prime is the transpose.

    Y (r, k) is Slotine and Li's regressor of r joints on the model's k parameters and S the diagonal matrix of their
    prior ranges (greatest plausible errors), SI units, so that a kilogram and a kilogram square metre can be compared;
    eigenvalues are in (N m)^2 s (N^2 s for prismatic joints). A motion excites persistently when the smallest stays
    above a positive bound, for some window length (Ioannou and Sun 1996, section 4.3): only then do estimates converge.

    `time` (w,) is the end of each window in s, from the run's start; `smallest` and `largest` (w,) are its extreme
    eigenvalues. `weakest` (k,) is the unit vector of parameters over their ranges that the whole run excites least;
    `window` is the windows' length in s. Nothing is checked.
    """

    time: Array
    smallest_eigenvalue: Array
    largest_eigenvalue: Array
    weakest_direction: Array
    """(k,) the least excited direction of scaled parameters over the whole run"""
    window: float

    @property
    def min_eigenvalue(self) -> float:
        """The least eigenvalue, over all windows of time along the run, of the excitation Gram matrices, in (N m)^2 s
        (N^2 s for prismatic joints). Such a matrix is the integral of (Y S)'(Y S) over its window: Y is Slotine and
        Li's regressor, S the diagonal matrix of the parameters' prior ranges (greatest plausible errors), a prime the
        transpose. It is 0 where some direction of the parameters is not excited in one of the windows."""
        return float(self.smallest_eigenvalue.min())

    @property
    def condition(self) -> Array:
        """Condition numbers (w,), without a unit, of Slotine and Li's regressor stacked over each of w windows of time
        along the run, its columns scaled by the parameters' prior ranges (greatest plausible errors). Each is the root
        of the ratio of the Gram matrix's largest eigenvalue to the smallest, infinite where the smallest is 0."""
        with np.errstate(divide="ignore"):
            return np.sqrt(self.largest_eigenvalue / self.smallest_eigenvalue)


def persistent_excitation(
    model: ReducedModel, run: SampledRun, window: float, *, bandwidth: ArrayLike = 0.0, scale: ArrayLike | None = None
) -> Excitation:
    """The excitation of the `model`'s k parameters by a `run`, an `Excitation`: extreme eigenvalues of the regressor's
    Gram matrix over windows of length `window` (s). That is rounded to whole samples, down to a multiple of 16; each
    window starts a sixteenth of it after the one before.

    `run` has positions p, velocities v and the reference's p_d, v_d and a_d, (T, r) of r joints in rad, rad/s and
    rad/s^2 (m, m/s and m/s^2 for prismatic joints), at T samples. The regressor is Slotine and Li's, at the reference
    velocity v_r = v_d - bandwidth e, e = p - p_d, and the reference acceleration a_r, its derivative; `bandwidth` is in
    1/s, one number or (r,), and at zero, the default, v_r and a_r are v_d and a_d. `scale` (k,), SI units, or one
    number are prior ranges of the parameters, their greatest plausible errors, by which the regressor's columns are
    scaled, those of `PriorRanges` where None. Eigenvalues are squares of singular values of triangular factors, so that
    their error, relative to the largest, is the square of what it would be from the Gram matrix itself. Raises
    `InputError` for a run of another number of joints than the model's mechanism has, for a window shorter than 16
    samples or longer than the run, for a bandwidth of another shape or NaN, and for a scale that is not finite or of
    another shape.
    """
    count, k = len(run.p), len(model.columns)
    if (joints := run.p.shape[1]) != model.mechanism.dof:
        raise InputError(f"run: expected {model.mechanism.dof} joints, as {model.mechanism.name} has, got {joints}")
    length = real_number(window, "window")
    samples = round(length / run.control_period) if np.isfinite(length) else 0
    if not BLOCKS <= samples <= count:
        shortest, longest = BLOCKS * run.control_period, count * run.control_period
        raise InputError(f"window: expected a time from {shortest:g} s to the run's {longest:g} s, got {window}")
    rows = scaled_regressor(model, *_arguments(run, per_joint(bandwidth, model.mechanism.dof, "bandwidth")), scale)
    size = samples // BLOCKS
    blocks = rows[: count // size * size].reshape(count // size, -1, k) * np.sqrt(run.control_period)
    factors = _triangular(blocks)
    for level in range(DOUBLINGS):
        # A factor of twice as many blocks from two that meet: small matrices throughout, whatever the window.
        factors = _triangular(np.concatenate((factors[: -(2**level)], factors[2**level :]), axis=1))
    values: Array = np.asarray(np.linalg.svd(factors, compute_uv=False), dtype=np.float64)
    end = (np.arange(len(values), dtype=np.float64) + BLOCKS) * size * run.control_period
    weakest = np.asarray(np.linalg.svd(_triangular(blocks.reshape(1, -1, k))[0])[2][-1])
    return Excitation(end, values[:, -1] ** 2, values[:, 0] ** 2, weakest, BLOCKS * size * run.control_period)


def _triangular(rows: Array) -> Array:
    """The triangular factors (n, k, k) of matrices (n, m, k), by parts of 2k rows."""
    n, _, k = rows.shape
    while rows.shape[1] > k:
        parts = -(-rows.shape[1] // (2 * k))
        padded = np.pad(rows, ((0, 0), (0, parts * 2 * k - rows.shape[1]), (0, 0)))
        factors: Array = np.asarray(np.linalg.qr(padded.reshape(n, parts, 2 * k, k), mode="r"))
        rows = factors.reshape(n, parts * k, k)
    return np.asarray(np.pad(rows, ((0, 0), (0, k - rows.shape[1]), (0, 0))))


def scaled_regressor(
    model: ReducedModel, p: Array, v: Array, v_r: Array, a_r: Array, scale: ArrayLike | None = None
) -> Array:
    """The scaled regressor Y_r S (T, r, k), N m (N if prismatic), along T samples of a motion of r joints. Y_r is
    Slotine and Li's torque regressor on the `model`'s k parameters, S the diagonal matrix of `scale`.

    Positions `p` are in rad (m), velocities `v` and reference velocities `v_r` in rad/s (m/s), reference accelerations
    `a_r` in rad/s^2 (m/s^2), all (T, r). `scale` (k,), SI units, or one number are the parameters' prior ranges, their
    greatest plausible errors, those of `PriorRanges` where None. Mechanisms of up to 100 links are computed in native
    code. Raises `InputError` on a wrong shape and for a scale that is not finite, `NonFiniteError` for positions that
    are not finite (velocities and accelerations are checked only above 100 links), `SingularityError` near a
    singularity of the kinematic loops.
    """
    ranges = PriorRanges().of(model.names) if scale is None else np.asarray(scale, dtype=np.float64)
    ranges = np.broadcast_to(ranges, (len(model.columns),)) if ranges.ndim == 0 else ranges
    return regressor_of(model)(p, v, v_r, a_r) * frozen_array(ranges, (len(model.columns),), "scale")


def regressor_of(model: ReducedModel) -> Callable[[Array, Array, Array, Array], Array]:
    """A function that computes Slotine and Li's torque regressor (T, r, k) of the `model`'s r joints and k parameters
    at T samples, in N m (N if prismatic) per SI unit of each parameter. It is native code, compiled here, for up to 100
    links, else NumPy.

    Its arguments are positions p in rad (m), velocities v and reference velocities v_r in rad/s (m/s) and reference
    accelerations a_r in rad/s^2 (m/s^2), all (T, r). It raises `InputError` on a wrong shape, `NonFiniteError` for
    positions that are not finite (velocities and accelerations are checked only above 100 links), `SingularityError`
    near a singularity of the kinematic loops.
    """
    mechanism, r = model.mechanism, model.mechanism.dof
    if len(mechanism.links) > LARGEST_COMPILED:
        return model.slotine_li_regressor
    equations = mechanism.equations

    def rows(q: Column, v: Column, v_r: Column, a_r: Column) -> Column:
        found = equations.torque_regressor(q, v, v_r, a_r, model.columns)
        return Column(entry for row in found for entry in row)

    kernel = compile_function(rows, {"q": equations.joints, "v": r, "v_r": r, "a_r": r}, name="regressor")

    def regressor(p: Array, v: Array, v_r: Array, a_r: Array) -> Array:
        found: Array = kernel.map(mechanism.configuration(p), v, v_r, a_r)
        return found.reshape(len(p), r, len(model.columns))

    return regressor


def _arguments(run: SampledRun, bandwidth: Array) -> tuple[Array, Array, Array, Array]:
    """p, v, v_r = v_d - bandwidth e and a_r (T, r) along a run."""
    e, rate = run.p - run.reference_p, run.v - run.reference_v
    return run.p, run.v, run.reference_v - bandwidth * e, run.reference_a - bandwidth * rate
