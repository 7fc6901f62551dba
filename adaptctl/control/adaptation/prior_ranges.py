"""Adaptation gains from prior ranges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import (
    Array,
    finite_number,
    frozen,
    frozen_array,
    per_joint,
    positive_number,
    positive_period,
    whole_number,
)
from adaptctl.control.adaptation.gradient import checked_gain
from adaptctl.control.adaptation.late_torques import MAX_DELAY
from adaptctl.control.gains.adaptation_ratio import adaptation_ratio, stable_adaptation_below
from adaptctl.control.gains.gains import Gains
from adaptctl.control.gains.sampling_ratio import sampling_ratio, stable_below
from adaptctl.control.gains.workspace import Workspace, workspace_of
from adaptctl.description.drive import HARMONICS
from adaptctl.dynamics import Mechanism
from adaptctl.errors import GainError, InputError, NotFoundError, TuningWarning, suggested_name, validate_kind, warn
from adaptctl.identifiability import ReducedModel


def parameter_sampling_ratios(
    model: ReducedModel, bandwidth: ArrayLike, control_period: float, workspace: Workspace | None = None
) -> Array:
    r"""
    Compute how much an error of each parameter adds to the sampling ratio.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    bandwidth : array_like
        Bandwidth Lambda in 1/s, one number or (r,).
    control_period : float
        Time in s for which a torque is held.
    workspace : Workspace, optional
        Joint positions whose samples are evaluated. Unless given, 200 random ones within the limits.

    Returns
    -------
    ndarray
        Largest additions (k,) to the sampling ratio for an error of 1 SI unit; 0 for friction.

    Raises
    ------
    InputError
        If the bandwidth is negative or of another shape, or the period not positive.

    Notes
    -----
    .. math:: T_c\max_q\|M^{-1/2}(\partial M/\partial\beta_i)\Lambda M^{-1/2}\|_F.

    Examples
    --------
    >>> adaptctl.control.parameter_sampling_ratios(model, 5.0, period).shape
    (6,)
    """
    mechanism = model.mechanism
    place = workspace_of(mechanism, workspace)
    L = per_joint(bandwidth, mechanism.dof, "bandwidth")
    if not np.all((L >= 0.0) & np.isfinite(L)):
        raise InputError(f"bandwidth: expected finite numbers of at least 0, got {L.tolist()}")
    positive_period(control_period, "control_period")
    values, vectors = np.linalg.eigh(place.mass_matrices)
    inverse = (vectors / np.sqrt(np.maximum(values, np.finfo(float).tiny))[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    shares = inertia_shares(model, place.samples)
    scaled = np.einsum("sij,skjl,slm->skim", inverse, shares * L, inverse, optimize=True)
    return np.asarray(control_period * np.sqrt((scaled**2).sum(axis=(-2, -1))).max(axis=0))


def inertia_shares(model: ReducedModel, p: Array) -> Array:
    """Derivatives (samples, k, r, r) of the mass matrix."""
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
    r"""
    Return an upper bound of what estimation errors add to the sampling ratio.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    gain : array_like
        Adaptation gain Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per J.
    prior : array_like
        Largest error (k,) of each initial parameter in SI units.
    bandwidth : array_like
        Bandwidth Lambda in 1/s, one number or (r,).
    control_period : float
        Time in s for which a torque is held.
    workspace : Workspace, optional
        Joint positions whose samples are evaluated. Unless given, 200 random ones within the limits.
    kinetic : float, default 0.0
        Initial energy s'Ms/2 of the sliding variable in J. Zero for a start on the reference.

    Returns
    -------
    float
        Bound without a unit. If the gains' sampling ratio plus this is below 2 (2 sin(pi/(4 d + 2)) where torques are d
        periods late), no estimate rings; most arms are stable above it too.

    Raises
    ------
    InputError
        If a number is negative or not finite, a shape is wrong, or the gain not positive definite.

    Notes
    -----
    .. math::

        H=\sqrt{2V_0\,u^\top|\Gamma|u},\quad V_0=\text{kinetic}+\tfrac12\text{prior}^\top|\Gamma^{-1}|\text{prior},

    with u of `parameter_sampling_ratios`, as the Lyapunov function never exceeds :math:`V_0`.

    Examples
    --------
    >>> ratio = adaptctl.control.estimate_sampling_ratio(model, np.full(6, 0.1), np.full(6, 0.2), 5.0, period)
    >>> ratio > 0.0
    True
    """
    k = len(model.columns)
    gamma = checked_gain(frozen_array(gain, (k, k) if np.ndim(gain) == 2 else (k,), "gain"))
    bound = frozen_array(prior, (k,), "prior")
    if np.any(bound < 0.0):
        raise InputError(f"prior: expected numbers of at least 0, got {bound.tolist()}")
    full = np.diag(gamma) if gamma.ndim == 1 else gamma
    energy = finite_number(kinetic, "kinetic") + 0.5 * _largest_distance(full, bound)
    u = parameter_sampling_ratios(model, bandwidth, control_period, workspace)
    return float(np.sqrt(2.0 * energy * (u @ np.abs(full) @ u)))


def _largest_distance(gamma: Array, bound: Array) -> float:
    """Bound of error' Gamma^-1 error."""
    return float(bound @ np.abs(np.linalg.inv(gamma)) @ bound)


SAMPLING_RATIO_SHARE = 0.2  # for each parameter, of what the gains leave below the limit of stability
ADAPTATION_RATIO_SHARE = 0.5  # at rest under gravity, of the limit with late torques
MAX_FALL = 1.0  # rad (m) under gravity from the first estimate, with late torques
UNKNOWN_SHARE = 0.3  # of gravity, even with the description's estimate
RANGE_OF_KIND = {
    "m": "mass",
    **dict.fromkeys(("mc_x", "mc_y", "mc_z"), "first_moment"),
    **dict.fromkeys(("I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz", "rotor_inertia"), "inertia"),
    **dict.fromkeys(("viscous", "square_root"), "viscous"),
    **dict.fromkeys(("coulomb", "stribeck", "offset", "stiffness", *(kind.value for kind in HARMONICS)), "coulomb"),
}


@dataclass(frozen=True)
class PriorRanges:
    """
    Largest plausible errors of initial parameters, by kind.

    Parameters
    ----------
    mass : float, default 5.0
        Range of masses in kg. Give less for light arms: gains grow with its square.
    first_moment : float, default 2.0
        Range of first moments in kg m. The default is the mass's at 0.4 m.
    inertia : float, default 0.6
        Range of inertias in kg m^2, of links and rotors. The default is the mass's at 0.35 m.
    viscous : float, default 5.0
        Range of viscous friction in N m s/rad (N s/m). The default is of the size of a PUMA 560's large joints.
    coulomb : float, default 10.0
        Range of Coulomb friction, and of springs' torques at 1 rad (1 m), in N m (N). The default is of the size of a
        PUMA 560's large joints.

    Raises
    ------
    InputError
        If a range is not positive and finite.

    Examples
    --------
    >>> adaptctl.PriorRanges(mass=2.0).for_parameters(("upper.m", "upper.mc_x"))
    array([2., 2.])
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
    def for_parameters(self, names: tuple[str, ...]) -> Array:
        """
        Return the ranges of parameters by name.

        Parameters
        ----------
        names : tuple of str
            Full names of k parameters, such as `link1.m`.

        Returns
        -------
        ndarray
            Ranges (k,) in SI units, read-only.

        Raises
        ------
        NotFoundError
            If what follows a name's last dot is no kind of parameter.
        """
        return frozen(np.array([self._range(name) for name in names]))

    def _range(self, name: str) -> float:
        kind = name.rsplit(".", 1)[-1]
        if kind not in RANGE_OF_KIND:
            known = f"one that ends in {', '.join(RANGE_OF_KIND)}{suggested_name(kind, RANGE_OF_KIND)}"
            raise NotFoundError(f"prior ranges: unknown kind of parameter {name!r}: expected {known}")
        return float(getattr(self, RANGE_OF_KIND[kind]))


def adaptation_gain(
    model: ReducedModel,
    ranges: PriorRanges | None = None,
    gain_scale: float = 0.6,
    *,
    gains: Gains | None = None,
    control_period: float = 1e-3,
    workspace: Workspace | None = None,
    delay: int = 0,
    initial: ArrayLike | None = None,
) -> Array:
    """
    Choose an adaptation gain from prior ranges of the parameters.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    ranges : PriorRanges, optional
        Largest plausible errors of the initial parameters, `PriorRanges()` unless given.
    gain_scale : float, default 0.6
        Factor in 1/J of the squared ranges: an error of a whole range counts 1/(2 gain_scale) J, for every parameter.
    gains : Gains, optional
        Gains of the control law. With them ranges are limited to 0.2 (2 sin(pi/(4 d + 2)) - h)/u, delay d, h the
        sampling ratio and u that of `parameter_sampling_ratios`, so that a light wrist does not ring. The adaptation
        ratio T lambda_max(K^-1 Y Gamma Y') at rest is limited to half of what is then stable.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    workspace : Workspace, optional
        Joint positions for these ratios. Unless given, all that the joints' limits allow.
    delay : int, default 0
        Control periods, 0 to 64, by which torques arrive late: an estimate that is too large then rings much earlier.
    initial : array_like, optional
        Estimate (k,) in SI units with which the controller begins. Default: zero.

    Returns
    -------
    ndarray
        Diagonal (k,) of the gain in units of the parameters squared per J.

    Raises
    ------
    GainError
        If the gains are unstable at this period and delay, or, with a delay, make up for what the initial estimate
        misses of gravity, or 30 % of it, only after an error of more than 1 rad (m): a falling arm may be lost.
    InputError
        If a number is not positive, gains are for another number of joints, or an estimate of parameters.

    Warns
    -----
    TuningWarning
        If that limit lowers the gain, with the factor.

    Examples
    --------
    >>> adaptctl.adaptation_gain(model, adaptctl.PriorRanges(mass=2.0)).shape
    (6,)
    """
    validate_kind(model, ReducedModel, "adaptation gain", "as ReducedModel(mechanism) is one")
    known = PriorRanges() if ranges is None else ranges
    validate_kind(known, PriorRanges, "adaptation gain: ranges", "as PriorRanges() is one")
    reach = known.for_parameters(model.names)
    if gains is not None:
        left = _left_by(gains, model.mechanism, control_period, workspace, delay)
        caused = parameter_sampling_ratios(model, gains.bandwidth, control_period, workspace)
        reach = np.minimum(reach, SAMPLING_RATIO_SHARE * left / np.maximum(caused, np.finfo(float).tiny))
    gain = positive_number(gain_scale, "adaptation gain: gain_scale: expected a positive number") * reach**2
    if gains is None:
        return gain
    p = workspace_of(model.mechanism, workspace).samples
    at_rest = model.torque_regressor(p, np.zeros_like(p), np.zeros_like(p))
    most = ADAPTATION_RATIO_SHARE * stable_adaptation_below(stable_below(delay) - left, delay)
    if (ratio := adaptation_ratio(at_rest, gains.damping, gain, control_period)) > most:
        gain = gain * (most / ratio)
        late = f" with a delay of {delay}" if delay else ""
        warn(
            f"{model.mechanism.name}: adaptation gain: lowered to {most / ratio:.2g} times what the ranges give: these "
            f"gains{late} allow an adaptation ratio at rest of {most:.2g}, and it was {ratio:.2g}",
            TuningWarning,
        )
    if delay:
        _validate_start(model, at_rest, gains, gain, delay, initial)
    return gain


def _validate_start(
    model: ReducedModel, at_rest: Array, gains: Gains, gain: Array, delay: int, initial: ArrayLike | None
) -> None:
    """Raise `GainError` if an arm falls far before gains or what it learns hold it, by regressors (S, r, k) at rest."""
    arm, own = model.mechanism, model.fundamental_parameters
    stiffness = np.diag(gains.damping * gains.bandwidth) + (at_rest * gain) @ np.swapaxes(at_rest, -1, -2)
    known = 0.0 if initial is None else frozen_array(initial, own.shape, "adaptation gain: initial")
    for begun, missing, cure in (
        (f"with {UNKNOWN_SHARE:.0%} of it unknown", UNKNOWN_SHARE * own, "take"),
        ("from this estimate", own - known, "begin with initial=model.fundamental_parameters, or take"),
    ):
        errors = np.abs(np.linalg.solve(stiffness, (at_rest @ missing)[..., None])).max(axis=(0, 2))
        joint, error = arm.primary_joints[int(errors.argmax())], errors.max()
        if error > MAX_FALL:
            raise GainError(
                f"{arm.name}: adaptation gain: {begun}, this gain holds gravity at {joint.name} only after an error of "
                f"{error:.2g} {joint.kind.position_unit}, and with a delay of {delay} falling arms may be lost: {cure} "
                "more damping, bandwidth or gain_scale, or the default law, as of tune"
            )


def _left_by(gains: Gains, arm: Mechanism, control_period: float, workspace: Workspace | None, delay: int) -> float:
    """Distance of the gains' sampling ratio from the limit of stability. Raises `GainError` above it."""
    validate_kind(gains, Gains, "adaptation gain: gains", "as Gains.from_bandwidth(...) gives them")
    held = sampling_ratio(arm, gains.damping, control_period, gains.bandwidth, workspace=workspace).value
    limit = stable_below(whole_number(delay, "delay in control periods", 0, MAX_DELAY))
    if not held < limit:
        late = f" and a delay of {delay}" if delay else ""
        raise GainError(
            f"{arm.name}: these gains are unstable at a period of {control_period:g} s{late}, so no adaptation gain is "
            f"stable: their sampling ratio is {held:.3g}, and the limit {limit:.3g}; use at most "
            f"{0.75 * limit / held:.3g} times this damping"
        )
    return limit - held


def mapped_gain(model: ReducedModel, gain: ArrayLike) -> Array:
    """
    Map an adaptation gain on all parameters to one on the base parameters.

    Parameters
    ----------
    model : ReducedModel
        Model with k of P parameters.
    gain : array_like
        Diagonal (P,) of the gain on all parameters, in their units squared per J.

    Returns
    -------
    ndarray
        Symmetric gain (k, k) in units of the parameters squared per J; the k parameters then adapt as all of them
        would.

    Raises
    ------
    InputError
        If the gain is not P finite numbers.

    Examples
    --------
    >>> adaptctl.control.mapped_gain(model, np.full(20, 0.1)).shape
    (6, 6)
    """
    full = frozen_array(gain, (model.regrouping.shape[1],), "gain on all parameters")
    mapped = (model.regrouping * full) @ model.regrouping.T
    return np.asarray(0.5 * (mapped + mapped.T))
