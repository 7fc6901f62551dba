"""Persistent excitation along a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, per_joint, real_number
from adaptctl.compilation import compile_function
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.control.adaptation import PriorRanges
from adaptctl.control.lyapunov import SampledRun
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column

BLOCK_DOUBLINGS = 4
BLOCKS_PER_WINDOW = 2**BLOCK_DOUBLINGS  # a window moves by one block


@dataclass(frozen=True, eq=False)
class Excitation:
    """
    Excitation of the parameters in windows along a run.

    Parameters
    ----------
    time : ndarray
        End (w,) of each window in s.
    smallest_eigenvalue, largest_eigenvalue : ndarray
        Extreme eigenvalues (w,) of each window's Gram matrix in (N m)^2 s (N^2 s).
    weakest_direction : ndarray
        Unit vector (k,) of the parameters, each divided by its range, along which the whole run excites least.
    window : float
        Length of the windows in s.

    Notes
    -----
    Gram matrices are integrals of the squared scaled regressor. A motion is persistently exciting if their smallest
    eigenvalue has a positive bound [1]_.

    References
    ----------
    .. [1] Ioannou and Sun, Robust Adaptive Control, 1996, section 4.3.

    Examples
    --------
    >>> excitation = adaptctl.control.persistent_excitation(model, run, window=0.1)
    >>> excitation.condition.shape == excitation.time.shape
    True
    """

    time: Array
    smallest_eigenvalue: Array
    largest_eigenvalue: Array
    weakest_direction: Array
    window: float

    @property
    def min_eigenvalue(self) -> float:
        """Least eigenvalue in any window in (N m)^2 s (N^2 s)."""
        return float(self.smallest_eigenvalue.min())

    @property
    def condition(self) -> Array:
        """Condition numbers (w,) of the stacked regressor."""
        with np.errstate(divide="ignore"):
            return np.sqrt(self.largest_eigenvalue / self.smallest_eigenvalue)


def persistent_excitation(
    model: ReducedModel, run: SampledRun, window: float, *, bandwidth: ArrayLike = 0.0, scale: ArrayLike | None = None
) -> Excitation:
    """
    Measure the excitation of a model's parameters along a run.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    run : Rollout
        Run of T samples.
    window : float
        Length of the windows in s, rounded to a multiple of 16 samples. Each window starts a sixteenth of its length
        after the one before.
    bandwidth : array_like, default 0.0
        Bandwidth in 1/s, one number or (r,), of the reference velocity. At 0 it is the desired velocity.
    scale : array_like, optional
        Prior ranges (k,) in SI units, or one number, those of `PriorRanges` unless given.

    Returns
    -------
    Excitation
        Extreme eigenvalues in each window, from triangular factors, whose errors are far smaller than the Gram
        matrix's.

    Raises
    ------
    InputError
        If the run has another number of joints, the window is shorter than 16 samples or longer than the run, or a
        number has a wrong shape.

    Examples
    --------
    >>> excitation = adaptctl.control.persistent_excitation(model, run, window=0.1)
    >>> excitation.min_eigenvalue >= 0.0
    True
    """
    count, k = len(run.p), len(model.columns)
    if (joints := run.p.shape[1]) != model.mechanism.dof:
        raise InputError(f"run: expected {model.mechanism.dof} joints, as {model.mechanism.name} has, got {joints}")
    length = real_number(window, "window")
    samples = round(length / run.sample_time) if np.isfinite(length) else 0
    if not BLOCKS_PER_WINDOW <= samples <= count:
        shortest, longest = BLOCKS_PER_WINDOW * run.sample_time, count * run.sample_time
        raise InputError(f"window: expected a time from {shortest:g} s to the run's {longest:g} s, got {window}")
    rows = scaled_regressor(model, *_arguments(run, per_joint(bandwidth, model.mechanism.dof, "bandwidth")), scale)
    size = samples // BLOCKS_PER_WINDOW
    blocks = rows[: count // size * size].reshape(count // size, -1, k) * np.sqrt(run.sample_time)
    factors = _triangular(blocks)
    for level in range(BLOCK_DOUBLINGS):
        # A factor of twice as many blocks from two that meet: small matrices throughout, whatever the window.
        factors = _triangular(np.concatenate((factors[: -(2**level)], factors[2**level :]), axis=1))
    values: Array = np.asarray(np.linalg.svd(factors, compute_uv=False), dtype=np.float64)
    end = (np.arange(len(values), dtype=np.float64) + BLOCKS_PER_WINDOW) * size * run.sample_time
    weakest = np.asarray(np.linalg.svd(_triangular(blocks.reshape(1, -1, k))[0])[2][-1])
    return Excitation(end, values[:, -1] ** 2, values[:, 0] ** 2, weakest, BLOCKS_PER_WINDOW * size * run.sample_time)


def _triangular(rows: Array) -> Array:
    """Triangular factors (n, k, k) of (n, m, k)."""
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
    """Regressor (T, r, k) scaled by prior ranges."""
    ranges = PriorRanges().for_parameters(model.names) if scale is None else np.asarray(scale, dtype=np.float64)
    ranges = np.broadcast_to(ranges, (len(model.columns),)) if ranges.ndim == 0 else ranges
    return regressor_of(model)(p, v, v_r, a_r) * frozen_array(ranges, (len(model.columns),), "scale")


def regressor_of(model: ReducedModel) -> Callable[[Array, Array, Array, Array], Array]:
    """Regressor function of p, v, v_r, a_r (T, r)."""
    mechanism, r = model.mechanism, model.mechanism.dof
    if len(mechanism.links) > MAX_COMPILED_LINKS:
        return model.slotine_li_regressor
    equations = mechanism.equations

    def rows(q: Column, v: Column, v_r: Column, a_r: Column) -> Column:
        found = equations.torque_regressor(q, v, v_r, a_r, model.columns)
        return Column(entry for row in found for entry in row)

    kernel = compile_function(rows, {"q": equations.num_joints, "v": r, "v_r": r, "a_r": r}, name="regressor")

    def regressor(p: Array, v: Array, v_r: Array, a_r: Array) -> Array:
        found: Array = kernel.map(mechanism.configuration(p), v, v_r, a_r)
        return found.reshape(len(p), r, len(model.columns))

    return regressor


def _arguments(run: SampledRun, bandwidth: Array) -> tuple[Array, Array, Array, Array]:
    e, rate = run.p - run.reference_p, run.v - run.reference_v
    return run.p, run.v, run.reference_v - bandwidth * e, run.reference_a - bandwidth * rate
