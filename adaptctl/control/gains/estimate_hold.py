"""The share of an estimate in the hold number: M^ Lambda is a velocity feedback that adaptation moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, per_joint, positive_number, real_number
from adaptctl.control.adaptation.gradient import checked_gain
from adaptctl.control.gains.workspace import Workspace, workspace_of
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel


def parameter_holds(
    model: ReducedModel, bandwidth: ArrayLike, period: float, workspace: Workspace | None = None
) -> Array:
    """Hold numbers (k,) of estimate errors: the most that an error of 1 SI unit in each of the `model`'s k parameters
    beta_i adds to the hold number, in 1 over the parameter's unit. They are T_c max_q |M^-1/2 (dM/dbeta_i) Lambda
    M^-1/2|.

    The hold number is T_c lambda_max(M^-1 (K + M^ Lambda)), lambda_max the largest eigenvalue, M the mass matrix, M^
    the estimated one and K the damping of Slotine and Li's law: a torque held over the control period T_c is stable
    while it is below 2. `bandwidth` is Lambda in 1/s, one number or one for each of r joints (r,), and `period` T_c in
    s. The maximum is over the positions q that are the samples of `workspace`, a set of joint positions, None for 200
    random ones that the joints' limits allow. The norm is Frobenius', which is never below the spectral one. A friction
    parameter is not in M: its number is 0. Raises `InputError` for a bandwidth of another shape, below 0 or not finite
    and a period that is not positive.
    """
    mechanism = model.mechanism
    place = workspace_of(mechanism, workspace)
    L = per_joint(bandwidth, mechanism.dof, "bandwidth")
    if not np.all((L >= 0.0) & np.isfinite(L)):
        raise InputError(f"bandwidth: expected finite numbers of at least 0, got {L.tolist()}")
    positive_number(period, "period: expected a positive time in s")
    values, vectors = np.linalg.eigh(place.mass_matrices)
    inverse = (vectors / np.sqrt(np.maximum(values, np.finfo(float).tiny))[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    shares = inertia_shares(model, place.samples)
    scaled = np.einsum("sij,skjl,slm->skim", inverse, shares * L, inverse, optimize=True)
    return np.asarray(period * np.sqrt((scaled**2).sum(axis=(-2, -1))).max(axis=0))


def inertia_shares(model: ReducedModel, p: Array) -> Array:
    """Derivatives (samples, k, r, r) of the mass matrix (r, r) of the `model`'s r joints with respect to each of its k
    parameters, at positions `p` (samples, r), rad (m if prismatic). They are in kg m^2 (kg between prismatic joints)
    per SI unit of the parameter. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity,
    `SingularityError` near a singularity of the kinematic loops."""
    rest, r = np.zeros_like(p), p.shape[-1]
    still = model.torque_regressor(p, rest, rest)
    columns = [model.torque_regressor(p, rest, np.broadcast_to(unit, p.shape)) - still for unit in np.eye(r)]
    return np.moveaxis(np.stack(columns, axis=-1), -2, -3)


def estimate_hold(
    model: ReducedModel,
    gain: ArrayLike,
    prior: ArrayLike,
    bandwidth: ArrayLike,
    period: float,
    workspace: Workspace | None = None,
    kinetic: float = 0.0,
) -> float:
    """The upper bound H, without a unit, of what the error of the parameter estimate can ever add to the hold number: H
    = sqrt(2 V_0 u'|Gamma|u). |.| is entry by entry, a prime the transpose.

    The hold number is T_c lambda_max(M^-1 (K + M^ Lambda)), lambda_max the largest eigenvalue, M the mass matrix, M^
    the estimated one and K the damping of Slotine and Li's law: a torque held over the control period T_c is stable
    while it is below 2. Lambda is the `bandwidth` in 1/s, one number or one for each of r joints (r,), and T_c the
    `period` in s.

    u (k,) are the hold numbers per unit of error in each of the `model`'s k parameters, from `parameter_holds`, over
    the samples of `workspace`, a set of joint positions, None for 200 random ones that the joints' limits allow. Gamma
    is the adaptation `gain`, its diagonal (k,) or whole (k, k), in units of the parameters squared per J. V_0 =
    `kinetic` + prior'|Gamma^-1|prior/2 (J) bounds the initial value of the law's Lyapunov function, which never rises:
    `prior` (k,), SI units, is the greatest magnitude of each parameter's error at the start, and `kinetic` (J) is
    s'Ms/2 then, 0 by default, with the sliding variable s.

    While h + H < 2, h the hold number with the true M for M^, no estimate on the way can ring. H is conservative: above
    2 most arms are stable all the same. Raises `InputError` for numbers of another shape or not finite, a gain that is
    not symmetric and positive definite, a prior, `kinetic` or bandwidth below 0, and a period that is not positive.
    """
    k = len(model.columns)
    gamma = checked_gain(frozen_array(gain, (k, k) if np.ndim(gain) == 2 else (k,), "gain"))
    bound = frozen_array(prior, (k,), "prior")
    if np.any(bound < 0.0):
        raise InputError(f"prior: expected numbers of at least 0, got {bound.tolist()}")
    if not 0.0 <= real_number(kinetic, "kinetic") < np.inf:
        raise InputError(f"kinetic: expected an energy in J of at least 0, got {kinetic}")
    full = np.diag(gamma) if gamma.ndim == 1 else gamma
    energy = kinetic + 0.5 * _largest_distance(full, bound)
    u = parameter_holds(model, bandwidth, period, workspace)
    return float(np.sqrt(2.0 * energy * (u @ np.abs(full) @ u)))


def _largest_distance(gamma: Array, bound: Array) -> float:
    """A bound of error' Gamma^-1 error where |error_i| <= bound_i; for a diagonal Gamma it is reached."""
    return float(bound @ np.abs(np.linalg.inv(gamma)) @ bound)
