"""The motion that a design is judged by: its energies, torques and couplings, linear in the parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen, frozen_array, positive_number, real_number, whole_number
from adaptctl.caching import cached_property
from adaptctl.control.controller import Reference
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.identifiability import EssentialSpace, FundamentalBasis, Priority, essential_space, fundamental_basis
from adaptctl.identifiability.energy_matrix import energies
from adaptctl.identifiability.factorisation import triangle
from adaptctl.identifiability.sampling import (
    States,
    characteristic_length,
    characteristic_rate,
    random_accelerations,
    states_within_limits,
)

Objective = Literal["energy", "torque", "coupling", "components"]
OBJECTIVES: tuple[str, ...] = get_args(Objective)
STILL = 1e-9
"""rad, m, rad/s or m/s by which states must differ to be a motion"""
SAMPLES, MOST = 1000, 100_000
NO_ENERGY = 1e-12
"""Share of the energy by which it must vary."""
SPEED, FASTEST = 0.25, 1e100
"""Of sqrt(g/L): about 1 rad/s for an arm of half a metre; and the largest, whose square is a number still."""
CARRIED = 1e-6
"""Share of the energy below which a parameter counts as zero."""


@dataclass(frozen=True, eq=False)
class DesignTask:
    """A task to judge a mechanism's design by: states of the `mechanism` in motion, positions `p` (rad, or m for a
    prismatic joint), velocities `v` (rad/s or m/s) and accelerations `a` (rad/s^2 or m/s^2), each (samples, r) for r
    primary (independently moving) joints, and their `origin`, in words.

    A cost of a design is the norm |M D| of a matrix M (n, P), of n <= P rows, times the P inertial parameters D (P,),
    ten a link (kg, kg m, kg m^2) and rotor inertias (kg m^2, kg for a prismatic joint), without friction. At
    construction raises `InputError` for arrays of other shapes or of fewer than two states, for a mechanism with
    relations that bind some of its inertial parameters, and for positions and velocities that are alike to 1e-9 rad, m,
    rad/s or m/s: a task without motion has no energy to judge by; `NonFiniteError` for NaN or infinity. Methods and
    properties raise `SingularityError` for states near a singularity of the mechanism's kinematic loops,
    `NonFiniteError` for states at which energies or torques overflow.
    """

    mechanism: Mechanism
    p: Array
    v: Array
    a: Array
    origin: str

    def __post_init__(self) -> None:
        if self.mechanism.parameter_names != self.mechanism.description.parameter_names:
            raise InputError(f"{self.mechanism.name}: a design needs ten parameters a link, but relations bind some")
        for what in ("p", "v", "a"):
            values = checked(getattr(self, what), self.mechanism.dof, f"task: {what}")
            object.__setattr__(self, what, frozen(np.array(np.atleast_2d(values))))
        if not self.p.shape == self.v.shape == self.a.shape or self.p.ndim > 2 or len(self.p) < 2:
            shapes = f"{self.p.shape}, {self.v.shape} and {self.a.shape}"
            raise InputError(f"task: expected one shape (T, {self.mechanism.dof}), T at least 2, got {shapes}")
        if max(float(np.ptp(self.p, axis=0).max()), float(np.ptp(self.v, axis=0).max())) < STILL:
            raise InputError("task: no motion: its states are all alike; give states that differ, or a reference")

    @classmethod
    def within_limits(
        cls, mechanism: Mechanism, samples: int = SAMPLES, seed: int = 0, speed: float = SPEED
    ) -> DesignTask:
        """The task, a `DesignTask`, of random states of a mechanism, 1000 by default, the same for the same `seed`:
        positions uniform within the joints' limits, velocities normally distributed with a standard deviation of
        `speed` sqrt(g/L) in rad/s and clipped to the joints' limits. L (m) is the mechanism's characteristic length,
        the largest distance from a joint to the next or to its link's frame, and g its gravity (m/s^2), the standard
        one where it has none.

        Accelerations are normal with a standard deviation of `speed`^2 g/L in rad/s^2; for prismatic joints both are
        times L (m/s, m/s^2). At a `speed` (unitless) of 1 kinetic and potential energy are of one magnitude; 0.25, the
        default, is typical of an arm at work. With loops, positions are on the assembly branch of the reference
        configuration (the loops closed in the same of several ways). Raises `InputError` for `samples` other than a
        whole number from 2 to 100000, a seed other than one from 0 to 2^32 - 1, a speed other than a number from 0 to
        1e100, a mechanism with relations that bind some of its inertial parameters, states that are all alike, and
        loops for which not enough states are found.
        """
        samples, seed = whole_number(samples, "task: samples", 2, MOST), whole_number(seed, "task: seed", 0, 2**32 - 1)
        speed = real_number(speed, "task: speed")
        if not 0.0 <= speed <= FASTEST:
            raise InputError(f"task: speed: expected a finite number of at least 0, at most {FASTEST:g}, got {speed}")
        generator, rate = np.random.default_rng(seed), characteristic_rate(mechanism)
        p = states_within_limits(mechanism, samples, seed).p
        v = speed / rate * random_accelerations(mechanism, samples, generator)
        a = speed**2 * random_accelerations(mechanism, samples, generator)
        fastest = np.array([joint.limits.velocity for joint in mechanism.primary_joints])
        words = f"{samples} random states within the joints' limits, at {speed:g} sqrt(g/L), seed {seed}"
        return cls(mechanism, p, np.clip(v, -fastest, fastest), a, words)

    @classmethod
    def along(cls, mechanism: Mechanism, reference: Reference, duration: float, samples: int = SAMPLES) -> DesignTask:
        """The task, a `DesignTask`, of following a `reference`, a function from times (s) to positions, velocities and
        accelerations of the joints, in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic): its states at evenly
        spaced times from 0 to `duration` (s), both included, 1000 of them by default. Raises `InputError` for `samples`
        other than a whole number from 2 to 100000, for a duration that is not positive and finite, for a reference of
        another number of joints or one that stands still, and for a mechanism with relations that bind some of its
        inertial parameters; `NonFiniteError` for a reference that is not finite."""
        whole_number(samples, "task: samples", 2, MOST)
        positive_number(duration, "task: duration: expected a positive number of s")
        p, v, a = reference(np.linspace(0.0, duration, samples))
        return cls(mechanism, p, v, a, f"{samples} states of the reference over {duration:g} s")

    @cached_property
    def space(self) -> EssentialSpace:
        """The essential space of the mechanism's P inertial parameters, an `EssentialSpace`: the k directions of
        parameters that change energies and torques. Its singular values and its right singular vectors V1 (P, k), for k
        identifiable parameters, are those of the task's energies about their mean, in J (root mean square over the
        states) per SI unit of each parameter. Raises `RankError` where the number of identifiable parameters cannot be
        certified."""
        return replace(essential_space(self.mechanism), states=self.origin, energies=partial(np.asarray, self._energy))

    @cached_property
    def basis(self) -> FundamentalBasis:
        """The fundamental basis of the mechanism, a `FundamentalBasis`: its k fundamental (base) parameters, and the
        regrouping equations, which give each as a sum of inertial parameters. Dependent parameters are removed in the
        default order (`Priority.default`). Raises `RankError` where the number of identifiable parameters cannot be
        certified."""
        return fundamental_basis(self.space, Priority())

    @cached_property
    def parameters(self) -> Array:
        """The mechanism's own P inertial parameters (P,) that enter energies, all but friction: of each link, in the
        mechanism's order, its mass m (kg), first moments mc_x, mc_y, mc_z (kg m) and inertia tensor's entries I_xx,
        I_xy, I_yy, I_xz, I_yz, I_zz (kg m^2), about the origin of its frame, then rotor inertias (kg m^2, or kg for a
        prismatic joint). Read-only."""
        own = self.mechanism.inertial_parameters[: self.mechanism.num_energy_parameters]
        return frozen_array(own, own.shape, "parameters")

    @cached_property
    def torque_limits(self) -> Array:
        """Torque limits (r,) of the r primary (independently moving) joints by which the task's torques are divided, N
        m (N for a prismatic joint): the joints' own. A joint without one gets four times its largest torque in up to
        200 random states at up to 2 rad/s (m/s) and 10 rad/s^2 (m/s^2), and at least 1 N m (N). Read-only."""
        return frozen(finite_torque_limits(self.mechanism))

    def validate_energy(self, parameters: ArrayLike | None = None) -> None:
        """Raise `InputError` unless the mechanism's energy, kinetic plus potential, varies over the task's states: its
        root mean square about its mean must be above 1e-12 of its root mean square. `parameters` are the P inertial
        ones (P,) in SI units, by default (None) the mechanism's own. Nothing is returned. Raises `InputError` too for
        another shape of parameters, `NonFiniteError` where one is not finite or the energy overflows."""
        varying, D = self.cost("energy", parameters), self._given(parameters)
        with np.errstate(over="ignore"):
            whole = self.mechanism.energy_regressor(self.p, self.v)[:, : len(D)] @ D
            size = float(np.linalg.norm(whole)) / np.sqrt(len(self.p))
        if varying <= NO_ENERGY * size:
            raise InputError(
                f"{self.mechanism.name}: its energy is the same in all states of the task: let it move, or move faster"
            )

    def matrix(self, objective: str) -> Array:
        """The matrix M (n, P), of n <= P rows, of the cost |M D| that `objective` names, for P inertial parameters D
        (P,) in SI units, in the order of the property `parameters`: M D is in J for "energy" and "components", a
        fraction of the torque limits (unitless) for "torque", and kg m^2 for "coupling".

        The cost is a root mean square over the states. For "energy" it is that of the energy about its mean: its square
        is half the mean square of the energy's differences among all pairs of states (Sheu and Walker 1991, equation
        8). For "torque" it is that of the joint torques as fractions of their limits, the squares summed over joints;
        for "coupling" that of the mass matrix's entries off the diagonal, averaged over pairs of joints too, each entry
        times the characteristic length (m; the largest distance from a joint to the next or to its link's frame) for
        each prismatic joint of its pair. For "components" it is that of the energy, by M = S V1' (k, P): the k singular
        values S of the energies that are not zero, times their right singular vectors V1 (P, k). Read-only. Raises
        `InputError` for another objective, and for "components" `RankError` where the number of identifiable parameters
        cannot be certified.
        """
        if not isinstance(objective, str) or objective not in OBJECTIVES:
            raise InputError(f"objective: expected one of {', '.join(OBJECTIVES)}, got {objective!r}")
        return frozen(getattr(self, f"_{objective}"))

    def cost(self, objective: str, parameters: ArrayLike | None = None) -> float:
        """The cost of the motion that `objective` names, for P inertial parameters (P,) in SI units, in the order of
        the property `parameters`, by default (None) the mechanism's own. It is a root mean square over the task's
        states: "energy" and "components" of the energy about its mean (J), "torque" of the torques as fractions of
        their limits (unitless; squares summed over joints), "coupling" of the mass matrix's entries off the diagonal
        (kg m^2; a mean over pairs of joints too). Raises `InputError` for another objective or shape of parameters,
        `NonFiniteError` where one is not finite or the cost overflows, and for "components" `RankError` where the
        number of identifiable parameters cannot be certified."""
        return float(np.linalg.norm(self._applied(self.matrix(objective), parameters)))

    def torques(self, parameters: ArrayLike | None = None) -> Array:
        """Root mean square torques (r,) of the r primary (independently moving) joints over the task's states, N m (N
        for a prismatic joint), without friction. `parameters` are the P inertial ones (P,) in SI units, in the order of
        the property `parameters`, by default (None) the mechanism's own. Raises `InputError` for another shape of
        parameters, `NonFiniteError` where one is not finite or the torques overflow."""
        return np.linalg.norm(self._applied(self._joint_torques, parameters), axis=-1)

    def components(self, percent: float, parameters: ArrayLike | None = None) -> int:
        """The least number of essential components that keep the root mean square energy to an error of at most
        `percent` (%; Sheu and Walker 1991, equation 23), for P inertial parameters (P,) in SI units, in the order of
        the property `parameters`, by default (None) the mechanism's own. Essential components are the parts of the
        inertial parameters along the right singular vectors of the task's energies. Raises `InputError` for a
        percentage that is no finite number of at least 0 or another shape of parameters, `NonFiniteError` where a
        parameter is not finite or the energy overflows, `RankError` where the number of identifiable parameters cannot
        be certified."""
        return int(component_counts(self._applied(self._components, parameters), percent))

    def nonzero_parameters(self, parameters: ArrayLike | None = None, share: float = CARRIED) -> tuple[str, ...]:
        """Names of the fundamental (base) parameters whose contribution to the energy is more than a fraction `share`
        (unitless, by default 1e-6) of the whole, in the order of the property `basis`. Energies, kinetic plus
        potential, are root mean squares about their mean over the task's states; a contribution is the energy that one
        parameter makes alone. `parameters` are the P inertial ones (P,) in SI units, in the order of the property
        `parameters`, by default (None) the mechanism's own. Raises `InputError` where the energy is constant, for
        another shape of parameters and a fraction that is no number, `NonFiniteError` where a parameter is not finite
        or the energy overflows, `RankError` where the number of identifiable parameters cannot be certified."""
        if math.isnan(real_number(share, "task: share")):
            raise InputError("task: share: expected a number, got nan")
        return tuple(
            name for name, weight in zip(self.basis.names, self.weights(parameters), strict=True) if weight > share
        )

    def weights(self, parameters: ArrayLike | None = None) -> Array:
        """Fractions (k,), unitless, of the energy that each of the k fundamental (base) parameters makes alone, in the
        order of the property `basis`: its root mean square energy about the mean over the task's states, divided by
        that of all. They need not sum to 1. `parameters` are the P inertial ones (P,) in SI units, in the order of the
        property `parameters`, by default (None) the mechanism's own. Raises `InputError` where the energy is constant
        (the test of `validate_energy`), and for another shape of parameters, `NonFiniteError` where one is not finite
        or the energy overflows, `RankError` where the number of identifiable parameters cannot be certified."""
        self.validate_energy(parameters)
        D = self._given(parameters)
        each = np.linalg.norm(self._energy[:, list(self.basis.columns)], axis=0)
        return each * np.abs(self.basis.regrouping @ D) / self.cost("energy", D)

    def link(self, name: str) -> int:
        """Index, from 0, of the link named `name` among the links that own ten inertial parameters each. Raises
        `InputError`, which lists these links, for a name that is not among them."""
        names = self.mechanism.description.body_names
        if name not in names:
            raise InputError(
                f"{self.mechanism.name}: there is no link {name!r} with inertia; links: {', '.join(names)}"
            )
        return names.index(name)

    def center_of_mass(self, link: str) -> Array:
        """The centre of mass (3,), m, of the link named `link`, in its frame; the frame's origin where the link's mass
        is not above 0. Raises `InputError` for unknown links."""
        ten = self.parameters[10 * self.link(link) :][:4]
        return np.asarray(ten[1:4] / ten[0]) if ten[0] > 0.0 else np.zeros(3)

    def with_parameters(self, parameters: ArrayLike) -> DesignTask:
        """Design task with the same states, a `DesignTask`, of the mechanism with other inertial parameters (P,), SI
        units, in the order of the property `parameters`: all P that enter energies. Friction and the states stay.
        Raises `InputError` for another shape of parameters, a link's parameter above 1e20 in size and a rotor inertia
        below 0 or above 1e20, `NonFiniteError` where one is not finite."""
        own = np.array(self.mechanism.inertial_parameters)
        own[: self.mechanism.num_energy_parameters] = self._given(parameters)
        return replace(self, mechanism=self.mechanism.with_parameters(own))

    def _given(self, parameters: ArrayLike | None) -> Array:
        D = self.parameters if parameters is None else checked(parameters, len(self.parameters), "parameters")
        if D.ndim > 1:
            raise InputError(f"parameters: expected shape {self.parameters.shape}, got {D.shape}")
        return D

    def _applied(self, matrix: Array, parameters: ArrayLike | None) -> Array:
        """M D (..., n). Raises `NonFiniteError` where its square is too large for numbers."""
        with np.errstate(over="ignore", invalid="ignore"):
            values = np.asarray(matrix @ self._given(parameters))
            if not np.isfinite(np.sum(np.square(values))):
                raise NonFiniteError(
                    "parameters: the cost is too large for numbers: give smaller ones, or slower states"
                )
        return values

    @cached_property
    def _energy(self) -> Array:
        values = energies(self.mechanism, States(self.p, self.v, self.origin))
        return triangle(values - values.mean(axis=0)) / np.sqrt(len(values))

    @cached_property
    def _components(self) -> Array:
        return self.space.singular_values[: self.space.rank, None] * self.space.basis.T

    @cached_property
    def _joint_torques(self) -> Array:
        Y = self.mechanism.torque_regressor(self.p, self.v, self.a, range(self.mechanism.num_energy_parameters))
        return np.stack([triangle(Y[:, j]) for j in range(Y.shape[1])]) / np.sqrt(len(Y))

    @cached_property
    def _torque(self) -> Array:
        return triangle(np.concatenate(self._joint_torques / self.torque_limits[:, None, None]))

    @cached_property
    def _coupling(self) -> Array:
        weightless = Mechanism(replace(self.mechanism.description, gravity=np.zeros(3)))
        rest, unit = np.zeros_like(self.p), np.eye(self.mechanism.dof)
        length = characteristic_length(self.mechanism)
        arms = [1.0 if joint.kind.is_revolute else length for joint in self.mechanism.primary_joints]
        columns = range(self.mechanism.num_energy_parameters)
        rows = [np.zeros((1, len(columns)))]
        for j in range(1, self.mechanism.dof):
            forces = weightless.torque_regressor(self.p, rest, rest + unit[j], columns)
            rows += [arms[i] * arms[j] * forces[:, i] for i in range(j)]
        return triangle(np.concatenate(rows)) / np.sqrt(max(1, math.comb(len(arms), 2)) * len(self.p))


def component_counts(weights: Array, percent: float) -> Array:
    """The least numbers (...) of essential components that keep the root mean square energy to an error of at most
    `percent` (%): the components of the least weight are left out as long as the root of their summed squares is at
    most `percent`/100 of the root of the summed squares of all (Sheu and Walker 1991, equation 23). `weights` (..., k),
    in J, are the root mean square energies of each of k essential components, the parts of the inertial parameters
    along the right singular vectors of the energies. Raises `InputError` for a percentage that is no finite number of
    at least 0."""
    percent = real_number(percent, "percent")
    if not 0.0 <= percent < np.inf:
        raise InputError(f"percent: expected a percentage of at least 0, got {percent}")
    squares = np.sort(np.square(weights), axis=-1)
    tails = np.cumsum(squares, axis=-1)
    return np.sum(tails > min(percent / 100.0, 1.0) ** 2 * tails[..., -1:], axis=-1)
