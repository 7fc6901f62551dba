"""Sampling ratio of a held torque."""

from __future__ import annotations

import math
from collections import deque
from functools import lru_cache
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, frozen_array, per_joint, positive_period, stacked_rows
from adaptctl.caching import sent_as_made
from adaptctl.compilation.object_cache import kept
from adaptctl.control.gains.workspace import Workspace, Worst, everywhere, workspace_of
from adaptctl.description.drive import DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.errors import GainError, InputError, validate_kind
from adaptctl.scalars import Column, column

MAX_SAMPLING_RATIO = 1.5  # a held torque is stable below 2; the rest is a margin
MIN_EIGENVALUE = 1e-12  # of a mass matrix scaled to a unit diagonal: positive beyond round-off


def stable_below(delay: int) -> float:
    """Sampling ratio at which a torque held and late by so many periods becomes unstable (Levin and May 1976)."""
    return 2.0 * math.sin(math.pi / (4 * delay + 2))


@sent_as_made
class SamplingRatio(NamedTuple):
    """
    Largest sampling ratio that a search found, with its joint positions.

    Parameters
    ----------
    value : float
        Sampling ratio without a unit, stable below 2.
    p : ndarray
        Positions (r,) in rad (m) where it was found.
    joint : str
        Joint that rings most there.

    Examples
    --------
    >>> adaptctl.control.sampling_ratio(arm, [6.0, 2.0], period).joint in ("shoulder", "elbow")
    True
    """

    value: float
    p: Array
    joint: str


def sampling_ratio(
    mechanism: Mechanism,
    damping: ArrayLike,
    control_period: float,
    bandwidth: ArrayLike = 0.0,
    *,
    estimate: ArrayLike | None = None,
    workspace: Workspace | None = None,
) -> SamplingRatio:
    r"""
    Compute the largest sampling ratio of a torque loop over joint positions, stable below 2.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    damping : array_like
        Damping gain K in N m s/rad (N s/m for a prismatic joint), one number or (r,).
    control_period : float
        Time in s for which a torque is held.
    bandwidth : array_like, default 0.0
        Bandwidth Lambda in 1/s, one number or (r,). Zero where K is the whole velocity gain, as of `PDGravity`.
    estimate : array_like, optional
        All inertial and friction parameters (P,) of the estimate in SI units, the mechanism's own unless given.
    workspace : Workspace, optional
        Joint positions that are searched. Unless given, 200 random ones within the joints' limits start the search.

    Returns
    -------
    SamplingRatio
        Largest ratio, and the joint positions and joint where it occurs. The ratio is infinite if the mass matrix is
        not positive definite.

    Raises
    ------
    InputError
        If damping or period is not positive, the bandwidth negative, a number not finite, or a shape wrong.

    Notes
    -----
    .. math:: T_c\lambda_{\max}(M^{-1}(K+\hat M\Lambda)).

    Here T_c is the control period, M the true mass matrix and the one with a hat that of the estimate. A held torque
    multiplies velocities by one minus this matrix in every period. Viscous friction B replaces M by
    :math:`M(X/2)\coth(X/2)`, :math:`X=T_cM^{-1}B`.

    Examples
    --------
    >>> adaptctl.control.sampling_ratio(arm, [6.0, 2.0], period, bandwidth=5.0).value < 1.5
    True
    """
    validate_kind(mechanism, Mechanism, "sampling ratio", "as load(...) gives one")
    validate_period(control_period)
    workspace = None if workspace is None else workspace_of(mechanism, workspace)
    K, L = per_joint(damping, mechanism.dof, "damping"), per_joint(bandwidth, mechanism.dof, "bandwidth")
    if not (np.all((K > 0.0) & np.isfinite(K)) and np.all((L >= 0.0) & np.isfinite(L))):
        raise InputError(
            f"sampling ratio: expected a positive damping and a bandwidth of at least 0, got {K.tolist()} and "
            f"{L.tolist()}"
        )
    known = None if estimate is None else tuple(_all_parameters(mechanism, estimate).tolist())
    return _searched(mechanism, workspace, tuple(K.tolist()), tuple(L.tolist()), float(control_period), known)


def _all_parameters(mechanism: Mechanism, values: ArrayLike) -> Array:
    return frozen_array(values, (len(mechanism.parameter_names),), f"{mechanism.name}: parameters")


@lru_cache(maxsize=64)
def _searched(
    mechanism: Mechanism,
    workspace: Workspace | None,
    damping: tuple[float, ...],
    bandwidth: tuple[float, ...],
    control_period: float,
    estimate: tuple[float, ...] | None,
) -> SamplingRatio:
    K, L = np.array(damping), np.array(bandwidth)
    if estimate is None and L.min() == L.max() and not np.any(_viscous(mechanism)):
        # T_c M^-1 (K + M lambda) = T_c (k M^-1 (K/k) + lambda): one search for all K in proportion and all such Lambda
        unit = _of_proportion(mechanism, workspace, tuple(float(f"{x:.14g}") for x in K / K.max()))
        return unit._replace(value=control_period * (float(K.max()) * unit.value + bandwidth[0]))
    return _stored(mechanism, workspace, damping, bandwidth, control_period, estimate)


@lru_cache(maxsize=64)
def _of_proportion(mechanism: Mechanism, workspace: Workspace | None, damping: tuple[float, ...]) -> SamplingRatio:
    """Sampling ratio of a period of 1 s without bandwidth."""
    return _stored(mechanism, workspace, damping, (0.0,) * len(damping), 1.0, None)


def _stored(mechanism: Mechanism, workspace: Workspace | None, *settings: Any) -> SamplingRatio:
    """Sampling ratio, cached on disk."""
    if workspace is not None:
        return _found(workspace, *settings)
    inputs = [mechanism.description.sha256, *settings]
    value, p, joint = kept(
        "sampling ratio", inputs, tuple[float, list[float], str], lambda: _in_json_types(mechanism, *settings)
    )
    return SamplingRatio(value, frozen(np.array(p)), joint)


def _in_json_types(mechanism: Mechanism, *settings: Any) -> tuple[float, list[float], str]:
    value, p, joint = _found(everywhere(mechanism), *settings)
    return value, p.tolist(), joint


def _found(
    workspace: Workspace,
    damping: tuple[float, ...],
    bandwidth: tuple[float, ...],
    control_period: float,
    estimate: tuple[float, ...] | None,
) -> SamplingRatio:
    mechanism, K, L = workspace.mechanism, np.array(damping), np.array(bandwidth)
    parameters = None if estimate is None else np.array(estimate)

    def masses(p: Array) -> Array:
        return workspace.mass_matrices if p is workspace.samples else mechanism.mass_matrix(p)

    def feedback(p: Array) -> Array:
        return _feedback(mechanism, p, masses(p), K, L, control_period, parameters)

    alone = parameters is None and not np.any(L) and not np.any(_viscous(mechanism))
    worst = workspace.maximum(lambda p: _of_damping(masses(p), K, control_period) if alone else _ratios_of(feedback(p)))
    if np.isinf(worst.value):
        return SamplingRatio(np.inf, worst.p, mechanism.primary_joints[_lightest_joint(mechanism, worst.p)].name)
    values, vectors = np.linalg.eig(feedback(worst.p[None])[0])
    joint = int(np.abs(vectors[:, values.real.argmax()] * np.sqrt(K)).argmax())
    return SamplingRatio(worst.value, worst.p, mechanism.primary_joints[joint].name)


def sampling_ratios(
    mechanism: Mechanism,
    p: ArrayLike,
    damping: ArrayLike,
    control_period: float,
    bandwidth: ArrayLike = 0.0,
    *,
    estimate: ArrayLike | None = None,
) -> Array:
    """Sampling ratios (...) at positions (..., r)."""
    K, L = per_joint(damping, mechanism.dof, "damping"), per_joint(bandwidth, mechanism.dof, "bandwidth")
    known = None if estimate is None else np.asarray(estimate, dtype=np.float64)
    p = np.asarray(p, dtype=np.float64)
    return _ratios_of(_feedback(mechanism, p, mechanism.mass_matrix(p), K, L, control_period, known))


def _feedback(
    mechanism: Mechanism,
    p: Array,
    M: Array,
    damping: Array,
    bandwidth: Array,
    control_period: float,
    estimate: Array | None,
) -> Array:
    """T_c M^-1 (K + M^ Lambda), infinite without positive definite M."""
    own = M if estimate is None else mass_matrix_of(mechanism, p, estimate)
    definite = np.asarray(scaled_eigenvalues(M) > MIN_EIGENVALUE)[..., :1, None]
    M = np.where(definite, M, np.eye(mechanism.dof))
    held = np.linalg.solve(
        sampled_inertia(mechanism, p, M, control_period), control_period * (np.diag(damping) + own * bandwidth)
    )
    return np.where(definite, held, np.inf)


def _of_damping(M: Array, damping: Array, control_period: float) -> Array:
    """T_c lambda_max(M^-1 K), of a symmetric problem, infinite without positive definite M."""
    least = np.linalg.eigvalsh(M / np.sqrt(damping[:, None] * damping))[..., 0]
    scale = damping / np.maximum(np.diagonal(M, axis1=-2, axis2=-1), MIN_EIGENVALUE)
    definite = np.asarray(least * scale.min(axis=-1) > MIN_EIGENVALUE)  # by Ostrowski's theorem
    if not definite.all():
        definite = (scaled_eigenvalues(M)[..., 0] > MIN_EIGENVALUE) & (least > 0.0)
    return np.where(definite, control_period / np.where(definite, least, 1.0), np.inf)


def _ratios_of(feedback: Array) -> Array:
    """Greatest eigenvalue, or |l|^2/Re l if complex."""
    finite = np.asarray(np.isfinite(feedback).all(axis=(-2, -1)))
    values = np.linalg.eigvals(np.where(finite[..., None, None], feedback, 0.0))
    damps = np.where(values.real > 0.0, values.real, 1.0)
    each = np.where(values.real > 0.0, np.abs(values) ** 2 / damps, np.inf)
    return np.where(finite, each.max(axis=-1), np.inf)


def sampled_inertia(mechanism: Mechanism, p: Array, M: Array, control_period: float) -> Array:
    """Inertia (..., r, r) under a held torque."""
    D = _viscous(mechanism)
    if not np.any(D):
        return M
    braking = damping_matrix(mechanism, p, D)
    values, vectors = np.linalg.eigh(M)
    root = (vectors * np.sqrt(values)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    inverse = (vectors / np.sqrt(values)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    halves, modes = np.linalg.eigh(0.5 * control_period * inverse @ braking @ inverse)
    shares = np.where(halves > 1e-6, halves / np.tanh(np.maximum(halves, 1e-6)), 1.0)
    side = root @ modes
    return np.asarray((side * shares[..., None, :]) @ np.swapaxes(side, -1, -2))


@lru_cache(maxsize=8)
def _viscous(mechanism: Mechanism) -> Array:
    """Parameters (P,), zero but those of viscous friction."""
    ending = f".{DriveParameter.VISCOUS.value}"
    return frozen(mechanism.inertial_parameters * [name.endswith(ending) for name in mechanism.parameter_names])


def damping_matrix(mechanism: Mechanism, p: Array, parameters: Array) -> Array:
    """Friction of parameters (P,) over velocity (..., r, r), near rest."""
    q = column(mechanism.configuration(p))
    rows = mechanism.equations.damping(q, Column.zeros(mechanism.dof), column(parameters))
    return stacked_rows(rows, p.shape[:-1])


def mass_matrix_of(mechanism: Mechanism, p: Array, parameters: Array) -> Array:
    """Mass matrix (..., r, r) of parameters (P,)."""
    rows = mechanism.equations.mass_matrix(column(mechanism.configuration(p)), column(parameters))
    return stacked_rows(rows, p.shape[:-1])


def scaled_eigenvalues(M: Array) -> Array:
    """Eigenvalues (..., r) at a unit diagonal."""
    diagonal = np.sqrt(np.abs(np.diagonal(M, axis1=-2, axis2=-1)))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    return np.asarray(np.linalg.eigvalsh(M / (scale[..., :, None] * scale[..., None, :])))


def worst_conditioned_configuration(
    mechanism: Mechanism, parameters: ArrayLike, workspace: Workspace | None = None
) -> Worst:
    """
    Find the joint positions at which a mass matrix is least positive definite.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    parameters : array_like
        All inertial and friction parameters (P,) in SI units.
    workspace : Workspace, optional
        Joint positions that are searched. Unless given, 200 random ones within the joints' limits start the search.

    Returns
    -------
    Worst
        Least eigenvalue of the mass matrix scaled to a unit diagonal, and the positions (r,). A positive value means
        positive definite wherever the search looked.

    Raises
    ------
    InputError
        If the parameters have another shape or are not finite.

    Examples
    --------
    >>> worst = adaptctl.control.worst_conditioned_configuration(arm, arm.inertial_parameters)
    >>> worst.value > 0.0, worst.p.shape
    (True, (2,))
    """
    D = _all_parameters(mechanism, parameters)
    found = workspace_of(mechanism, workspace).maximum(
        lambda p: -scaled_eigenvalues(mass_matrix_of(mechanism, p, D))[..., 0]
    )
    return Worst(-found.value, found.p)


def slowest_decay(mechanism: Mechanism, damping: ArrayLike, workspace: Workspace | None = None) -> float:
    """Least eigenvalue of M^-1 K, 1/s."""
    root = 1.0 / np.sqrt(per_joint(damping, mechanism.dof, "damping"))
    found = workspace_of(mechanism, workspace).maximum(
        lambda p: np.asarray(np.linalg.eigvalsh(mechanism.mass_matrix(p) * (root[:, None] * root))[..., -1])
    )
    return 1.0 / found.value


def validate_sampling_ratio(
    mechanism: Mechanism,
    damping: ArrayLike,
    control_period: float,
    bandwidth: ArrayLike = 0.0,
    workspace: Workspace | None = None,
) -> None:
    """Raise `GainError` if the sampling ratio exceeds 1.5."""
    K, L = per_joint(damping, mechanism.dof, "damping"), per_joint(bandwidth, mechanism.dof, "bandwidth")
    accepted = _accepted(mechanism, workspace, control_period)
    if np.all(K > 0.0) and np.all(L >= 0.0) and any(np.all(more >= K) and np.all(top >= L) for more, top in accepted):
        return
    found = sampling_ratio(mechanism, K, control_period, L, workspace=workspace)
    if not found.value <= MAX_SAMPLING_RATIO:
        _refuse(mechanism, found, control_period, float(np.max(L)))
    if not np.any(_viscous(mechanism)):  # what it adds to M is not proved to leave the order as it is
        accepted.append((K, L))


@lru_cache(maxsize=64)
def _accepted(mechanism: Mechanism, workspace: Workspace | None, control_period: float) -> deque[tuple[Array, Array]]:
    return deque(maxlen=16)


def _refuse(mechanism: Mechanism, found: SamplingRatio, control_period: float, bandwidth: float) -> NoReturn:
    where = f"p = {np.round(found.p, 3).tolist()}"
    if np.isinf(found.value):
        raise GainError(
            f"{mechanism.name}: the mass matrix is not positive definite everywhere, so the damping cannot be "
            f"checked: at {where} joint {found.joint} moves {_missing_inertia(mechanism, found.p)}"
        )
    own = control_period * bandwidth
    factor = max(MAX_SAMPLING_RATIO - own, 0.0) / (found.value - own) if found.value > own else 0.0
    raise GainError(
        f"{mechanism.name}: damping is too stiff for a control period of {control_period:g} s: T_c lambda_max(M^-1 (K "
        f"+ M Lambda)) = {found.value:.3g} at {where}, above the limit of {MAX_SAMPLING_RATIO}; use at most "
        f"{factor:.3g} times this damping or a period of at most "
        f"{control_period * MAX_SAMPLING_RATIO / found.value:.3g} s. Joint {found.joint} would oscillate: less damping "
        "there, or its rotor inertia in the model, may be sufficient; `workspace` restricts the check to the reference"
    )


def _lightest_joint(mechanism: Mechanism, p: Array) -> int:
    """Joint that moves most along the direction in which the mass matrix is least."""
    M = mechanism.mass_matrix(p)
    diagonal = np.diagonal(M)
    if np.any(diagonal <= 0.0):
        return int(diagonal.argmin())
    scale = np.sqrt(diagonal)
    return int(np.abs(np.linalg.eigh(M / np.outer(scale, scale))[1][:, 0]).argmax())


def _missing_inertia(mechanism: Mechanism, p: Array) -> str:
    """Phrase on a joint's inertia and the remedy."""
    links, inertia = mechanism.description.inconsistent_links, np.diagonal(mechanism.mass_matrix(p))
    if links and np.abs(inertia).min() > MIN_EIGENVALUE * np.abs(inertia).max():
        return f"inconsistent links: give {', '.join(links)} physically consistent parameters"
    return "no inertia: give it a link with inertia, or a rotor inertia"


def validate_period(control_period: float) -> None:
    """Raise `InputError` unless the period is positive."""
    positive_period(control_period, "control period")
