"""Verification of inertial transfers: every joint's rank by geometry against sampled energies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array, stacked
from adaptctl.description import GROUND
from adaptctl.description.inertia import parameter_names
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion import energy
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.identifiability.sampling import States
from adaptctl.identifiability.scaled_rank import FLOOR, SMALLEST_NORM, length_scales
from adaptctl.identifiability.tree.pseudo_inertia import frame_changes
from adaptctl.identifiability.tree.unobservable_inertia import BODY, InertialTransfers
from adaptctl.scalars import column


@dataclass(frozen=True, eq=False)
class TransferEvidence:
    """The evidence for the rank of a tree's energies: at each joint, the rank of the energy changes, at sampled states,
    when inertial parameters are moved from its link to the parent link, against that by geometry. Ratios have no unit;
    sigma_1 >= sigma_2 >= ... are a joint's singular values, k its rank by geometry.

    `surplus` is the sum over the joints of ranks by energies less those by geometry, 0 if all agree; `gap` the smallest
    sigma_k/sigma_k+1 of all joints, `smallest` the smallest sigma_k/sigma_1; `residual` the largest energy change by a
    combination of parameters that by geometry makes none, over the largest that one of its size could make; `weakest`
    (11,) the singular values of the joint with the smallest gap; `leftover` the largest sigma_k+1/sigma_1, round-off if
    the ranks agree, and `worst` the zero-based index of the joint that has that `leftover`. Nothing is checked at
    construction.
    """

    surplus: int
    """Sum over the joints of ranks by energies, less those by geometry."""
    gap: float
    """Smallest sigma_k/sigma_k+1 at the rank k by geometry."""
    smallest: float
    """Smallest sigma_k/sigma_1."""
    residual: float
    """Largest energy change by an unobservable body, over the largest that a body of its size could make."""
    weakest: Array
    """Singular values (11,) of the joint with the smallest gap."""
    leftover: float
    """Largest sigma_k+1/sigma_1, round-off where the ranks agree."""
    worst: int
    """Zero-based index of the joint that has that `leftover`."""


def energy_changes(mechanism: Mechanism, found: InertialTransfers, states: States) -> Array:
    """Energy changes (N, samples, 11), in J per kg, as a body is moved from the link of each of a tree's N joints to
    the parent link, at `samples` given `states`. They are the kinetic plus potential energy of the body on the joint's
    link, less its energy on the parent link (on the ground for a joint there), in the pose that it has there at joint
    position zero.

    They are per unit of each of a body's parameters: the ten (m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz)
    in the joint's frame, with lengths in units of the tree's characteristic length, and the joint's rotor inertia, 0
    where it has none. `mechanism` is the tree, `found` are its inertial transfers, whose joint frames are used. A
    combination of the eleven is unobservable at a joint exactly when the energy changes in no state. Nothing is
    checked.
    """
    energies = _energies(mechanism, found.frames.length, states) @ frame_changes(
        np.asarray(np.linalg.inv(found.frames.far), dtype=np.float64)
    )
    before = np.zeros((len(energies) + 1, *energies.shape[1:]))
    before[:-1] = energies
    before[GROUND, :, 1:4] = -mechanism.description.gravity * found.frames.length
    out = np.zeros((*energies.shape[:2], BODY))
    out[..., :10] = energies - before[list(found.parents)] @ found.to_parent
    rotors = np.array([own.bodies[10].any() for own in found.own]) * found.frames.rotor_scales
    out[..., 10] = 0.5 * rotors[:, None] * states.v.T**2
    return out


def transfer_evidence(found: InertialTransfers, changes: Array) -> TransferEvidence:
    """The evidence for a tree's rank: at each of N joints, the singular values of the energy `changes` (N, samples,
    11), in J per kg, against the rank by geometry in `found`, the tree's inertial transfers.

    The changes, of `energy_changes` at `samples` states, 11 or more, are per unit of each of 11 inertial parameters
    that is moved from a link to its parent; columns are divided by their norms, or by 1e-3 of the joint's largest norm
    where that is more. Raises `numpy.linalg.LinAlgError` for NaN.
    """
    norms = np.linalg.norm(changes, axis=1, keepdims=True)
    scales = 1.0 / np.maximum(norms, SMALLEST_NORM * norms.max(axis=2, keepdims=True))
    values = np.linalg.svd(changes * scales, compute_uv=False)
    relative = np.maximum(values / values[:, :1], FLOOR)
    ratios = relative[:, :-1] / relative[:, 1:]
    ranks = np.array([len(functionals) for functionals in found.observable])
    last, beyond = (np.arange(len(ranks)), ranks - 1), (np.arange(len(ranks)), ranks)
    return TransferEvidence(
        surplus=int((ratios.argmax(axis=1) + 1 - ranks).sum()),
        gap=float(ratios[last].min()),
        smallest=float(relative[last].min()),
        residual=_residual(found, changes),
        weakest=values[ratios[last].argmin()],
        leftover=float(relative[beyond].max()),
        worst=int(relative[beyond].argmax()),
    )


def _energies(mechanism: Mechanism, length: float, states: States) -> Array:
    """Energies (N, samples, 10) of the ten of every link, massless ones too, with lengths in units of `length`."""
    tree, places, rates = TreeEquations.of(mechanism.description), column(states.p), column(states.v)
    row = energy.energy_regressor(tree.links, places, rates, tree.gravity)
    energies = stacked(row.of, (len(states),)).reshape(len(states), -1, 10)
    return energies.transpose(1, 0, 2) * length_scales(parameter_names(["link"]), length)


def _residual(found: InertialTransfers, changes: Array) -> float:
    """Largest relative energy change by an unobservable body, over all joints."""
    pairs = zip(found.observable, found.unobservable, strict=True)
    bodies = np.stack([np.vstack([0.0 * functionals, bodies]) for functionals, bodies in pairs])
    sizes = np.abs(changes).max(axis=(1, 2))[:, None] * np.abs(bodies).max(axis=2)
    largest = np.abs(changes @ bodies.mT).max(axis=1)
    return float(np.divide(largest, sizes, out=np.zeros_like(sizes), where=sizes > 0.0).max())
