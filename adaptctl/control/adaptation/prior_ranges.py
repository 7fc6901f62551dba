"""Adaptation gains from prior ranges of the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, frozen_array, per_joint, positive_number, real_number
from adaptctl.control.adaptation.gradient import checked_gain
from adaptctl.control.gains.gains import Gains
from adaptctl.control.gains.sampling_ratio import sampling_ratio
from adaptctl.control.gains.workspace import Workspace, workspace_of
from adaptctl.errors import GainError, InputError, NotFoundError, suggested_name, validate_kind
from adaptctl.identifiability import ReducedModel


def parameter_sampling_ratios(
    model: ReducedModel, bandwidth: ArrayLike, control_period: float, workspace: Workspace | None = None
) -> Array:
    """Sampling ratios (k,) of estimate errors: the most that an error of 1 SI unit in each of the `model`'s k
    parameters beta_i adds to the sampling ratio, in 1 over the parameter's unit. They are T_c max_q |M^-1/2
    (dM/dbeta_i) Lambda M^-1/2|.

    The sampling ratio is T_c lambda_max(M^-1 (K + M^ Lambda)), lambda_max the largest eigenvalue, M the mass matrix, M^
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
    positive_number(control_period, "control_period: expected a positive time in s")
    values, vectors = np.linalg.eigh(place.mass_matrices)
    inverse = (vectors / np.sqrt(np.maximum(values, np.finfo(float).tiny))[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    shares = inertia_shares(model, place.samples)
    scaled = np.einsum("sij,skjl,slm->skim", inverse, shares * L, inverse, optimize=True)
    return np.asarray(control_period * np.sqrt((scaled**2).sum(axis=(-2, -1))).max(axis=0))


def inertia_shares(model: ReducedModel, p: Array) -> Array:
    """Derivatives (samples, k, r, r) of the mass matrix (r, r) of the `model`'s r joints with respect to each of its k
    parameters, at positions `p` (samples, r), rad (m if prismatic). They are in kg m^2 (kg between prismatic joints)
    per SI unit of the parameter. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity,
    `SingularityError` near a singularity of the kinematic loops."""
    rest, r = np.zeros_like(p), p.shape[-1]
    still = model.torque_regressor(p, rest, rest)
    columns = [model.torque_regressor(p, rest, np.broadcast_to(unit, p.shape)) - still for unit in np.eye(r)]
    return np.moveaxis(np.stack(columns, axis=-1), -2, -3)


def estimate_sampling_ratio(
    model: ReducedModel,
    gain: ArrayLike,
    prior: ArrayLike,
    bandwidth: ArrayLike,
    control_period: float,
    workspace: Workspace | None = None,
    kinetic: float = 0.0,
) -> float:
    """The upper bound H, without a unit, of what the error of the parameter estimate can ever add to the sampling
    ratio: H = sqrt(2 V_0 u'|Gamma|u). |.| is entry by entry, a prime the transpose.

    The sampling ratio is T_c lambda_max(M^-1 (K + M^ Lambda)), lambda_max the largest eigenvalue, M the mass matrix, M^
    the estimated one and K the damping of Slotine and Li's law: a torque held over the control period T_c is stable
    while it is below 2. Lambda is the `bandwidth` in 1/s, one number or one for each of r joints (r,), and T_c the
    `period` in s.

    u (k,) are the sampling ratios per unit of error in each of the `model`'s k parameters, from
    `parameter_sampling_ratios`, over the samples of `workspace`, a set of joint positions, None for 200 random ones
    that the joints' limits allow. Gamma is the adaptation `gain`, its diagonal (k,) or whole (k, k), in units of the
    parameters squared per J. V_0 = `kinetic` + prior'|Gamma^-1|prior/2 (J) bounds the initial value of the law's
    Lyapunov function, which never rises: `prior` (k,), SI units, is the greatest magnitude of each parameter's error at
    the start, and `kinetic` (J) is s'Ms/2 then, 0 by default, with the sliding variable s.

    While h + H < 2, h the sampling ratio with the true M for M^, no estimate on the way can ring. H is conservative:
    above 2 most arms are stable all the same. Raises `InputError` for numbers of another shape or not finite, a gain
    that is not symmetric and positive definite, a prior, `kinetic` or bandwidth below 0, and a period that is not
    positive.
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
    u = parameter_sampling_ratios(model, bandwidth, control_period, workspace)
    return float(np.sqrt(2.0 * energy * (u @ np.abs(full) @ u)))


def _largest_distance(gamma: Array, bound: Array) -> float:
    """A bound of error' Gamma^-1 error where |error_i| <= bound_i; for a diagonal Gamma it is reached."""
    return float(bound @ np.abs(np.linalg.inv(gamma)) @ bound)


SAMPLING_RATIO_SHARE = 0.2
"""of what the gains leave of the sampling ratio, for each parameter"""
RANGES = {
    "m": "mass",
    **dict.fromkeys(("mc_x", "mc_y", "mc_z"), "first_moment"),
    **dict.fromkeys(("I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz", "rotor_inertia"), "inertia"),
    **dict.fromkeys(("viscous", "square_root"), "viscous"),
    **dict.fromkeys(("coulomb", "stribeck", "offset"), "coulomb"),
}
"""The range of each kind of parameter."""


@dataclass(frozen=True)
class PriorRanges:
    """Prior ranges of parameters by kind: the greatest plausible magnitudes of the initial estimate's error, from which
    adaptation gains are made. `mass` is in kg, 5 by default; `first_moment` in kg m, 2; `inertia` in kg m^2, 0.6;
    `viscous` friction in N m s/rad (N s/m for a prismatic joint), 5; and `coulomb` friction in N m (N), 10. Raises
    `InputError` unless all are positive and finite.

    Parameters of different kinds need gains of different size: one gain for a mass in kg and an inertia in kg m^2 would
    learn one of them far too slowly or far too fast.
    """

    mass: float = 5.0
    first_moment: float = 2.0
    inertia: float = 0.6
    viscous: float = 5.0
    coulomb: float = 10.0

    def __post_init__(self) -> None:
        for kind in ("mass", "first_moment", "inertia", "viscous", "coulomb"):
            positive_number(getattr(self, kind), f"prior range of {kind}: expected a positive number")

    @lru_cache(maxsize=64)  # noqa: B019  # a few numbers each, asked for by every controller of a sweep
    def of(self, names: tuple[str, ...]) -> Array:
        """The prior ranges (k,), in the parameters' SI units and read-only, of the k parameters with the full `names`,
        such as `link1.m`, in their order.

        What follows the last dot counts: `m` has the range `mass`, `mc_...` the range `first_moment`, `viscous` and
        `square_root` the range `viscous`, `coulomb`, `stribeck` and `offset` the range `coulomb`, `I_...` and
        `rotor_inertia` the range `inertia`. Raises `NotFoundError` for another name.
        """
        return frozen(np.array([self._range(name) for name in names]))

    def _range(self, name: str) -> float:
        kind = name.rsplit(".", 1)[-1]
        if kind not in RANGES:
            known = f"one that ends in {', '.join(RANGES)}{suggested_name(kind, RANGES)}"
            raise NotFoundError(f"prior ranges: there is no range of a parameter {name!r}: expected {known}")
        return float(getattr(self, RANGES[kind]))


def adaptation_gain(
    model: ReducedModel,
    ranges: PriorRanges | None = None,
    gain_scale: float = 0.6,
    *,
    gains: Gains | None = None,
    control_period: float = 1e-3,
    workspace: Workspace | None = None,
) -> Array:
    """The diagonal (k,) of the adaptation gain Gamma for the `model`'s k parameters, in units of the parameters squared
    per J: `rate`, in 1/J, 0.6 by default, times the square of each parameter's prior range. A prior range, its greatest
    plausible error, is taken from `ranges`, `PriorRanges()` where None.

    In the Lyapunov function an error of a whole range then counts 1/(2 rate), 0.83 J by default, for every parameter.

    With the `gains` of a control law, its bandwidth Lambda (1/s) and damping K (N m s/rad, N s/m for a prismatic
    joint), no range is taken greater than 0.2 (2 - h)/u: otherwise a light wrist, whose inertia a prior range lets be
    learned a hundred times too large, would ring. The sampling ratio h = T_c lambda_max(M^-1 (K + M Lambda)) of these
    gains has no unit and is stable below 2, with the largest eigenvalue lambda_max, the mass matrix M and the control
    `period` T_c in s, 1 ms by default; u is what an error of 1 SI unit in the parameter adds to it
    (`parameter_sampling_ratios`). Both are the greatest over the set of joint positions `workspace`, all that the
    joints' limits allow where None: h by a local search, u over its samples. `period` and `workspace` are not used
    where `gains` is None, the default.

    Raises `GainError` where h is 2 or more, and `InputError` for a rate that is not positive and finite and, with
    gains, for a period or damping that is not positive and for gains of another number of joints.
    """
    validate_kind(model, ReducedModel, "adaptation gain", "as ReducedModel(mechanism, basis) is one")
    known = PriorRanges() if ranges is None else ranges
    validate_kind(known, PriorRanges, "adaptation gain: ranges", "as PriorRanges() is one")
    reach = known.of(model.names)
    if gains is not None:
        held = sampling_ratio(
            model.mechanism, gains.damping, control_period, gains.bandwidth, workspace=workspace
        ).value
        caused = parameter_sampling_ratios(model, gains.bandwidth, control_period, workspace)
        reach = np.minimum(
            reach, SAMPLING_RATIO_SHARE * max(2.0 - held, 0.0) / np.maximum(caused, np.finfo(float).tiny)
        )
    if not np.all(reach > 0.0):
        raise GainError(
            f"{model.mechanism.name}: a period of {control_period:g} s does not carry these gains: nothing is left"
        )
    return np.asarray(positive_number(gain_scale, "adaptation gain: rate: expected a positive number") * reach**2)


def mapped_gain(model: ReducedModel, gain: ArrayLike) -> Array:
    """The adaptation gain Gamma_beta = K_r Gamma_D K_r' (k, k) of a model's k fundamental (base) parameters, for a
    diagonal gain Gamma_D, `gain` (P,), on all P parameters; both in units of the parameters squared per J.

    K_r (k, P) is the model's attribute `regrouping`, K_r' its transpose: K_r times all P parameters gives the k
    fundamental ones. With Gamma_beta, adapting the k fundamental parameters is the same controller as adapting all P,
    to round-off. Gamma_beta is symmetric to the last bit. Raises `InputError` unless the gain is P finite numbers.
    """
    full = frozen_array(gain, (model.regrouping.shape[1],), "gain on all parameters")
    mapped = (model.regrouping * full) @ model.regrouping.T
    return np.asarray(0.5 * (mapped + mapped.T))
