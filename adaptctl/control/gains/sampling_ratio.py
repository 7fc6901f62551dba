"""The sampling ratio: how much velocity feedback a torque that is held over the control period carries."""

from __future__ import annotations

from collections import deque
from functools import lru_cache
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, frozen_array, per_joint, positive_number, stacked_rows
from adaptctl.caching import sent_as_made
from adaptctl.compilation.object_cache import kept
from adaptctl.control.gains.workspace import Workspace, Worst, everywhere, workspace_of
from adaptctl.description.drive import DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.errors import GainError, InputError, validate_kind
from adaptctl.scalars import column

MAX_SAMPLING_RATIO = 1.5
"""A torque held over T_c is stable while the sampling ratio is below 2; the rest is a margin."""
DEFINITE = 1e-12
"""Least eigenvalue of a mass matrix, its diagonal scaled to 1, that is positive beyond round-off."""


@sent_as_made
class SamplingRatio(NamedTuple):
    """Record of the greatest sampling ratio that a search over a set of joint positions found. `value` is that number,
    without a unit, `p` (r,), rad (m if prismatic), the positions of the r joints where it was found, and `joint` the
    name of the joint that rings most there.

    The sampling ratio is T_c lambda_max(M^-1 (K + M^ Lambda)), and a held torque is stable while it is below 2. T_c is
    the control period in s, M the mass matrix, M^ the estimated one, K the damping in N m s/rad (N s/m), Lambda the
    bandwidth in 1/s and lambda_max the largest eigenvalue; where eigenvalues l are complex, the greatest |l|^2/Re l.
    The search (`Workspace.maximum`) is a local one that starts at the worst samples of the set, by default 200 random
    positions within the joints' limits. `joint` has the largest entry of sqrt(K) x, x being the eigenvector of the
    eigenvalue with the greatest real part; where `value` is infinite, it has the least diagonal entry of M, if that is
    not positive, or else the largest entry of the eigenvector of the least eigenvalue of M, scaled to a unit diagonal.
    Nothing is checked.
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
    """The greatest sampling ratio T_c lambda_max(M^-1 (K + M^ Lambda)), without a unit, and the positions where it is,
    a `SamplingRatio`, by a local search over `workspace`. A torque held over the control period T_c is stable while the
    number is below 2.

    lambda_max is the largest eigenvalue (where eigenvalues l are complex, the greatest |l|^2/Re l), M the mass matrix
    of the `mechanism`, `damping` K in N m s/rad (N s/m if prismatic) and `bandwidth` Lambda in 1/s, 0 by default, each
    one number or one for each of r joints (r,); `period` is T_c in s. Slotine and Li's law feeds back -K v, v the
    joints' velocities, and within its reference acceleration -M^ Lambda v, where M^ is the mass matrix of the
    `estimate` (P,) of all P inertial and friction parameters, SI units, in the order of `parameter_names`, None for the
    mechanism's own. From one period to the next v becomes (1 - T_c M^-1 (K + M^ Lambda)) v, which grows, with
    alternating signs, where the number is above 2. The number is infinite where M is not positive definite, and where
    an eigenvalue has a real part of 0 or less. The search starts at the worst samples of `workspace`, a set of joint
    positions, None for 200 random ones within the joints' limits.

    Viscous friction with coefficients B acts within the period: M is then replaced by M (X/2) coth(X/2), X = T_c M^-1
    B, for which the limit of 2 is exact. Raises `InputError` unless damping and period are positive, the bandwidth at
    least 0 and all finite, and on a wrong shape.
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
    if estimate is None and L.min() == L.max() and not np.any(_viscous(mechanism)[1]):
        # T_c M^-1 (K + M lambda) = T_c (k M^-1 (K/k) + lambda): one search for all K in proportion and all such Lambda
        unit = _of_proportion(mechanism, workspace, tuple(float(f"{x:.14g}") for x in K / K.max()))
        return unit._replace(value=control_period * (float(K.max()) * unit.value + bandwidth[0]))
    return _kept(mechanism, workspace, damping, bandwidth, control_period, estimate)


@lru_cache(maxsize=64)
def _of_proportion(mechanism: Mechanism, workspace: Workspace | None, damping: tuple[float, ...]) -> SamplingRatio:
    """The sampling ratio without a bandwidth, for a period of 1 s."""
    return _kept(mechanism, workspace, damping, (0.0,) * len(damping), 1.0, None)


def _kept(mechanism: Mechanism, workspace: Workspace | None, *settings: Any) -> SamplingRatio:
    """The sampling ratio; over all that the limits allow it is searched once, also for later processes."""
    if workspace is not None:
        return _found(workspace, *settings)
    inputs = [mechanism.description.sha256, *settings]
    value, p, joint = kept(
        "sampling ratio", inputs, tuple[float, list[float], str], lambda: _plain(mechanism, *settings)
    )
    return SamplingRatio(value, frozen(np.array(p)), joint)


def _plain(mechanism: Mechanism, *settings: Any) -> tuple[float, list[float], str]:
    """The same in JSON's types."""
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

    def feedback(p: Array) -> Array:
        M = workspace.mass_matrices if p is workspace.samples else mechanism.mass_matrix(p)
        return _feedback(mechanism, p, M, K, L, control_period, parameters)

    worst = workspace.maximum(lambda p: _hold_numbers(feedback(p)))
    if np.isinf(worst.value):
        return SamplingRatio(np.inf, worst.p, mechanism.primary_joints[_weightless(mechanism, worst.p)].name)
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
    """Sampling ratios T_c lambda_max(M^-1 (K + M^ Lambda)) (...), without a unit, at given positions `p` (..., r) of
    the r joints of a `mechanism`, rad (m if prismatic). A torque held over the control period T_c is stable while the
    number is below 2.

    M is the mass matrix, lambda_max the largest eigenvalue (where eigenvalues l are complex, the greatest |l|^2/Re l),
    `damping` K in N m s/rad (N s/m) and `bandwidth` Lambda in 1/s, 0 by default, each one number or (r,); `period` is
    T_c in s. M^ is the mass matrix of the `estimate`, (P,) or (..., P), of all P inertial and friction parameters, SI
    units, in the order of `parameter_names`, None for the mechanism's own. The number is infinite where M is not
    positive definite, and where an eigenvalue has a real part of 0 or less. Where there is viscous friction B, M (X/2)
    coth(X/2) stands in place of the inverted M, X = T_c M^-1 B. Raises `InputError` on a wrong shape of `p`, damping or
    bandwidth, `NonFiniteError` on NaN in these and infinity in `p`, `SingularityError` near a singularity of the
    kinematic loops; signs, `period` and `estimate` are not checked.
    """
    K, L = per_joint(damping, mechanism.dof, "damping"), per_joint(bandwidth, mechanism.dof, "bandwidth")
    known = None if estimate is None else np.asarray(estimate, dtype=np.float64)
    p = np.asarray(p, dtype=np.float64)
    return _hold_numbers(_feedback(mechanism, p, mechanism.mass_matrix(p), K, L, control_period, known))


def _feedback(
    mechanism: Mechanism,
    p: Array,
    M: Array,
    damping: Array,
    bandwidth: Array,
    control_period: float,
    estimate: Array | None,
) -> Array:
    """T_c M^-1 (K + M^ Lambda) (..., r, r), infinite where M is not positive definite."""
    own = M if estimate is None else mass_matrix_of(mechanism, p, estimate)
    definite = np.asarray(scaled_eigenvalues(M) > DEFINITE)[..., :1, None]
    M = np.where(definite, M, np.eye(mechanism.dof))
    held = np.linalg.solve(
        sampled_inertia(mechanism, p, M, control_period), control_period * (np.diag(damping) + own * bandwidth)
    )
    return np.where(definite, held, np.inf)


def _hold_numbers(feedback: Array) -> Array:
    """The radius (...) of the smallest circle through 0, about a point of the real axis, that holds the eigenvalues:
    the greatest of them where they are real and positive."""
    finite = np.asarray(np.isfinite(feedback).all(axis=(-2, -1)))
    values = np.linalg.eigvals(np.where(finite[..., None, None], feedback, 0.0))
    damps = np.where(values.real > 0.0, values.real, 1.0)
    each = np.where(values.real > 0.0, np.abs(values) ** 2 / damps, np.inf)
    return np.where(finite, each.max(axis=-1), np.inf)


def sampled_inertia(mechanism: Mechanism, p: Array, M: Array, control_period: float) -> Array:
    """Inertia (..., r, r) that a torque feels that is held over the `period` T_c (s), kg m^2 (kg between prismatic
    joints): M (X/2) coth(X/2), X = T_c M^-1 B, B being the viscous friction of the `mechanism`; without any, M itself.
    `M` (..., r, r) are its positive definite mass matrices at positions `p` (..., r), rad (m). Nothing is checked."""
    columns, D = _viscous(mechanism)
    if not np.any(D):
        return M
    units = np.eye(mechanism.dof)
    rows = [mechanism.torque_regressor(p, np.broadcast_to(u, p.shape), np.zeros_like(p), columns) @ D for u in units]
    values, vectors = np.linalg.eigh(M)
    root = (vectors * np.sqrt(values)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    inverse = (vectors / np.sqrt(values)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    halves, modes = np.linalg.eigh(0.5 * control_period * inverse @ np.stack(rows, axis=-1) @ inverse)
    shares = np.where(halves > 1e-6, halves / np.tanh(np.maximum(halves, 1e-6)), 1.0)
    side = root @ modes
    return np.asarray((side * shares[..., None, :]) @ np.swapaxes(side, -1, -2))


@lru_cache(maxsize=8)
def _viscous(mechanism: Mechanism) -> tuple[tuple[int, ...], Array]:
    """Indices of the parameters of viscous friction, and their values."""
    names = mechanism.parameter_names
    columns = tuple(j for j, name in enumerate(names) if name.endswith(f".{DriveParameter.VISCOUS.value}"))
    return columns, frozen(mechanism.inertial_parameters[list(columns)])


def mass_matrix_of(mechanism: Mechanism, p: Array, parameters: Array) -> Array:
    """The mass matrix M (..., r, r) of the r joints of a `mechanism`, kg m^2 (kg between prismatic joints), for given
    `parameters`. Positions `p` are (..., r), rad (m). The parameters are all P inertial and friction ones, (P,) or
    (..., P), in SI units; for such as no rigid body has, M need not be positive definite. Raises `InputError` on a
    wrong shape of `p`, `NonFiniteError` on NaN or infinity in it, `SingularityError` near a singularity of the
    kinematic loops; the parameters are not checked."""
    rows = mechanism.equations.mass_matrix(column(mechanism.configuration(p)), column(parameters))
    return stacked_rows(rows, p.shape[:-1])


def scaled_eigenvalues(M: Array) -> Array:
    """Eigenvalues (..., r), in ascending order, without a unit, of symmetric matrices `M` (..., r, r), such as mass
    matrices of r joints, scaled to a diagonal of magnitude 1. Row and column i are divided by sqrt|M_ii|, but not where
    that is 0. All eigenvalues are above 0 where M is positive definite. NaN and infinity are not looked for; matrices
    that are not square raise `ValueError`."""
    diagonal = np.sqrt(np.abs(np.diagonal(M, axis1=-2, axis2=-1)))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    return np.asarray(np.linalg.eigvalsh(M / (scale[..., :, None] * scale[..., None, :])))


def worst_conditioned_configuration(
    mechanism: Mechanism, parameters: ArrayLike, workspace: Workspace | None = None
) -> Worst:
    """The least eigenvalue of a mass matrix, its diagonal scaled to 1, that a local search over `workspace` finds: a
    `Worst` with this `value`, without a unit, and the positions `p` (r,) of the r joints, rad (m if prismatic), where
    it is.

    The mass matrix is that of `parameters` (P,), all P inertial and friction parameters of the `mechanism` in SI units
    and the order of its `parameter_names`; a value above 0 means that it is positive definite wherever the search
    looked. The search starts from the worst samples of `workspace`, a set of joint positions, None for 200 random ones
    within the joints' limits. Raises `InputError` for parameters of another shape or not finite.
    """
    D = _all_parameters(mechanism, parameters)
    found = workspace_of(mechanism, workspace).maximum(
        lambda p: -scaled_eigenvalues(mass_matrix_of(mechanism, p, D))[..., 0]
    )
    return Worst(-found.value, found.p)


def slowest_decay(mechanism: Mechanism, damping: ArrayLike, workspace: Workspace | None = None) -> float:
    """The least eigenvalue of M^-1 K, in 1/s, that a local search over `workspace` finds: under the torque -K v all
    velocities v of the r joints decay at least as fast. M is the mass matrix of the `mechanism`, `damping` K in N m
    s/rad (N s/m if prismatic), one number or (r,). The search starts from the worst samples of `workspace`, a set of
    joint positions, None for 200 random ones within the joints' limits. Raises `InputError` for a damping of another
    shape and `NonFiniteError` for NaN in it; that it is positive is not checked."""
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
    """Raise `GainError` where the sampling ratio T_c lambda_max(M^-1 (K + M Lambda)), no unit, is above 1.5 at some
    position that a local search over `workspace` finds, or the mass matrix M of the `mechanism` is not positive
    definite there. The message says which gains the period allows.

    T_c is the control `period` (s), over which a held torque is stable below 2, and lambda_max the largest eigenvalue.
    `damping` is K in N m s/rad (N s/m if prismatic) and `bandwidth` Lambda in 1/s, 0 by default, each one number or
    (r,) for r joints. The search starts from the worst samples of `workspace`, a set of joint positions, None for 200
    random ones within the joints' limits. Raises `InputError` unless damping and period are positive, the bandwidth at
    least 0 and all finite, and on a wrong shape.

    Gains of which none is above gains that were accepted need no search: of M^-1 K + Lambda, similar to S + Lambda with
    S = K^1/2 M^-1 K^1/2, the greatest eigenvalue l rises with each of K and Lambda. It does with Lambda, by Weyl; and
    with K, for S becomes D S D, D >= 1 diagonal, and D^-1 u, u being the eigenvector of l, has a Rayleigh quotient of
    at least l, since l >= Lambda_i.
    """
    K, L = per_joint(damping, mechanism.dof, "damping"), per_joint(bandwidth, mechanism.dof, "bandwidth")
    accepted = _accepted(mechanism, workspace, control_period)
    if np.all(K > 0.0) and np.all(L >= 0.0) and any(np.all(more >= K) and np.all(top >= L) for more, top in accepted):
        return
    found = sampling_ratio(mechanism, K, control_period, L, workspace=workspace)
    if not found.value <= MAX_SAMPLING_RATIO:
        _refuse(mechanism, found, control_period, float(np.max(L)))
    if not np.any(_viscous(mechanism)[1]):  # what it adds to M is not proved to leave the order as it is
        accepted.append((K, L))


@lru_cache(maxsize=64)
def _accepted(mechanism: Mechanism, workspace: Workspace | None, control_period: float) -> deque[tuple[Array, Array]]:
    """Dampings and bandwidths of late that the period was found to carry."""
    return deque(maxlen=16)


def _refuse(mechanism: Mechanism, found: SamplingRatio, control_period: float, bandwidth: float) -> NoReturn:
    where = f"p = {np.round(found.p, 3).tolist()}"
    if np.isinf(found.value):
        raise GainError(
            f"{mechanism.name}: the mass matrix is not positive definite everywhere, so no damping can be checked "
            f"against it: at {where} joint {found.joint} moves {_lightness(mechanism, found.p)}"
        )
    own = control_period * bandwidth
    factor = max(MAX_SAMPLING_RATIO - own, 0.0) / (found.value - own) if found.value > own else 0.0
    raise GainError(
        f"{mechanism.name}: damping is too stiff for a control period of {control_period:g} s: T_c "
        f"lambda_max(M^-1 (K + M "
        f"Lambda)) = {found.value:.3g} at {where}, at most {MAX_SAMPLING_RATIO} is allowed; use at most "
        f"{factor:.3g} times this damping or a period of at most "
        f"{control_period * MAX_SAMPLING_RATIO / found.value:.3g} s. Joint {found.joint} would ring: less "
        f"damping there, or "
        "its rotor's inertia in the model, may be enough; a `workspace` along the reference leaves out the rest"
    )


def _weightless(mechanism: Mechanism, p: Array) -> int:
    """The joint that moves most where M has its least eigenvalue."""
    M = mechanism.mass_matrix(p)
    diagonal = np.diagonal(M)
    if np.any(diagonal <= 0.0):
        return int(diagonal.argmin())
    scale = np.sqrt(diagonal)
    return int(np.abs(np.linalg.eigh(M / np.outer(scale, scale))[1][:, 0]).argmax())


def _lightness(mechanism: Mechanism, p: Array) -> str:
    """A phrase for what a joint moves where the mass matrix is not positive definite, and for the remedy."""
    links, inertia = mechanism.description.inconsistent_links, np.diagonal(mechanism.mass_matrix(p))
    if links and np.abs(inertia).min() > DEFINITE * np.abs(inertia).max():
        return f"what no rigid body is: give {', '.join(links)} physically consistent parameters"
    return "nothing: give it a link with inertia, or a rotor"


def validate_period(control_period: float) -> None:
    """Raise `InputError` unless the control `period`, a number in s, is positive and finite."""
    positive_number(control_period, "control period: expected a positive time in s")
