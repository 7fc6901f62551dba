"""States for design studies."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import (
    Array,
    checked,
    finite_number,
    frozen,
    frozen_array,
    positive_number,
    random_seed,
    real_number,
    whole_number,
)
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
# Difference in rad, m, rad/s or m/s that makes states a motion.
MIN_MOTION = 1e-9
NUM_SAMPLES, MAX_SAMPLES = 1000, 100_000
# Share of the energy by which it must vary.
MIN_ENERGY_RATIO = 1e-12
# Share of sqrt(g/L), about 1 rad/s for an arm of half a metre; and the largest, whose square does not overflow.
DEFAULT_SPEED, MAX_SPEED = 0.25, 1e100
# Share of the energy below which a parameter counts as zero.
MIN_ENERGY_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class DesignTask:
    """
    Mechanism, and states of its motion for which its design is evaluated.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r primary (independent) joints, without constraints on its parameters.
    p : numpy.ndarray
        Positions (samples, r) in rad, or m for a prismatic joint.
    v : numpy.ndarray
        Velocities (samples, r) in rad/s or m/s.
    a : numpy.ndarray
        Accelerations (samples, r) in rad/s^2 or m/s^2.
    origin : str
        Origin of the states in words, for reports.

    Raises
    ------
    InputError
        If shapes differ, there are fewer than two states, all are alike to 1e-9, or the mechanism is constrained
        (`NonFiniteError` for NaN and infinity).

    Notes
    -----
    A cost is the norm :math:`|M D|` with a matrix :math:`M` (n, P), see `matrix`, and the P inertial parameters
    :math:`D` without friction. Methods raise `SingularityError` near a singularity of closed loops, `NonFiniteError`
    where a cost overflows, `RankError` where they need a rank that cannot be certified.

    Examples
    --------
    >>> from adaptctl.design import DesignTask
    >>> task = DesignTask.within_limits(arm, samples=20)
    >>> task.cost("energy") > 0.0, task.torques().shape
    (True, (2,))
    >>> task.nonzero_parameters()
    ('upper.mc_x', 'upper.I_zz', 'lower.mc_x', 'lower.I_zz')
    """

    mechanism: Mechanism
    p: Array
    v: Array
    a: Array
    origin: str

    def __post_init__(self) -> None:
        if self.mechanism.parameter_names != self.mechanism.description.parameter_names:
            raise InputError(f"{self.mechanism.name}: a design needs ten parameters per link, but constraints fix some")
        for what in ("p", "v", "a"):
            values = checked(getattr(self, what), self.mechanism.dof, f"task: {what}")
            object.__setattr__(self, what, frozen(np.array(np.atleast_2d(values))))
        if not self.p.shape == self.v.shape == self.a.shape or self.p.ndim > 2 or len(self.p) < 2:
            shapes = f"{self.p.shape}, {self.v.shape} and {self.a.shape}"
            raise InputError(
                f"task: expected one shape (samples, {self.mechanism.dof}), at least 2 samples, got {shapes}"
            )
        if max(float(np.ptp(self.p, axis=0).max()), float(np.ptp(self.v, axis=0).max())) < MIN_MOTION:
            raise InputError("task: the states are all equal; give different states, or a reference")

    def __repr__(self) -> str:
        return f"<DesignTask of {self.mechanism.name!r}: {self.origin}>"

    @classmethod
    def within_limits(
        cls, mechanism: Mechanism, samples: int = NUM_SAMPLES, seed: int = 0, speed: float = DEFAULT_SPEED
    ) -> DesignTask:
        """
        Draw random states within a mechanism's limits.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r primary (independent) joints.
        samples : int, default 1000
            Random states, 2 to 100000. 1000 estimate a root mean square to a few percent.
        seed : int, default 0
            Seed of the states, from 0 to 2^32 - 1. Fixed, so that a task can be repeated.
        speed : float, default 0.25
            Scale of the velocities, without unit: at 1 kinetic and potential energy have about the same size, and 0.25
            is typical of an arm at work.

        Returns
        -------
        DesignTask
            Positions are uniform. Velocities and accelerations are normal, of standard deviations speed sqrt(g/L) rad/s
            and speed^2 g/L rad/s^2, with the characteristic length L and gravity g; velocities are clipped to limits.

        Raises
        ------
        InputError
            If a number is out of range, the mechanism is constrained, or too few states of its loops are found.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> DesignTask.within_limits(arm, samples=50, seed=1).v.shape
        (50, 2)
        """
        samples, seed = whole_number(samples, "task: samples", 2, MAX_SAMPLES), random_seed(seed, "task: seed")
        speed = real_number(speed, "task: speed")
        if not 0.0 <= speed <= MAX_SPEED:
            raise InputError(f"task: speed: expected a finite number of at least 0, at most {MAX_SPEED:g}, got {speed}")
        generator, rate = np.random.default_rng(seed), characteristic_rate(mechanism)
        p = states_within_limits(mechanism, samples, seed).p
        v = speed / rate * random_accelerations(mechanism, samples, generator)
        a = speed**2 * random_accelerations(mechanism, samples, generator)
        fastest = np.array([joint.limits.velocity for joint in mechanism.primary_joints])
        words = f"{samples} random states within the joint limits, at {speed:g} sqrt(g/L), seed {seed}"
        return cls(mechanism, p, np.clip(v, -fastest, fastest), a, words)

    @classmethod
    def from_reference(
        cls, mechanism: Mechanism, reference: Reference, duration: float, samples: int = NUM_SAMPLES
    ) -> DesignTask:
        """
        Sample the states of following a reference.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r primary (independent) joints.
        reference : Reference
            Function of time in s that returns positions, velocities and accelerations.
        duration : float
            Duration in s.
        samples : int, default 1000
            Evenly spaced times, 2 to 100000. 1000 resolve 20 periods with 50 samples each.

        Returns
        -------
        DesignTask
            States of the reference.

        Raises
        ------
        InputError
            If a number is out of range, the reference has other joints or rests, or the mechanism is constrained.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> DesignTask.from_reference(arm, reference, 2.0, samples=50).p.shape
        (50, 2)
        """
        whole_number(samples, "task: samples", 2, MAX_SAMPLES)
        positive_number(duration, "task: duration: expected a positive number of s")
        p, v, a = reference(np.linspace(0.0, duration, samples))
        return cls(mechanism, p, v, a, f"{samples} states of the reference over {duration:g} s")

    @cached_property
    def essential_space(self) -> EssentialSpace:
        """Essential space of the task's energies."""
        return replace(essential_space(self.mechanism), states=self.origin, energies=partial(np.asarray, self._energy))

    @cached_property
    def basis(self) -> FundamentalBasis:
        """Fundamental basis, for the default order in which parameters are removed."""
        return fundamental_basis(self.essential_space, Priority())

    @cached_property
    def parameters(self) -> Array:
        """Inertial parameters (P,) in SI units, rotor inertias last."""
        own = self.mechanism.inertial_parameters[: self.mechanism.num_energy_parameters]
        return frozen_array(own, own.shape, "parameters")

    @cached_property
    def torque_limits(self) -> Array:
        """Torque limits (r,) in N m (N if prismatic); where unknown, four times the largest torque of random states."""
        return frozen(finite_torque_limits(self.mechanism))

    def validate_energy(self, parameters: ArrayLike | None = None) -> None:
        """
        Raise `InputError` for parameters whose energy does not vary over the states.

        Parameters
        ----------
        parameters : array_like, optional
            Inertial parameters (P,) in SI units; the mechanism's own by default.

        Raises
        ------
        InputError
            If the energy varies by at most 1e-12 of its root mean square, or the shape is wrong.
        """
        varying, D = self.cost("energy", parameters), self._given(parameters)
        with np.errstate(over="ignore"):
            whole = self.mechanism.energy_regressor(self.p, self.v)[:, : len(D)] @ D
            size = float(np.linalg.norm(whole)) / np.sqrt(len(self.p))
        if varying <= MIN_ENERGY_RATIO * size:
            raise InputError(
                f"{self.mechanism.name}: the energy is equal in all states of the task; give a motion, or higher "
                "velocities"
            )

    def cost_matrix(self, objective: str) -> Array:
        """
        Return the matrix whose product with the inertial parameters has the cost as its norm.

        Parameters
        ----------
        objective : {"energy", "torque", "coupling", "components"}
            Cost, as `cost` computes it.

        Returns
        -------
        numpy.ndarray
            Matrix M (n, P), n at most P, read-only; M D is in J, without unit for "torque", in kg m^2 for "coupling".

        Raises
        ------
        InputError
            If the objective is unknown.

        Notes
        -----
        For "energy" the squared cost is half the mean square of the differences among all pairs of states (Sheu and
        Walker 1991, equation 8). For "components" M is S V1', the singular values times the transposed basis of the
        essential space.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> DesignTask.within_limits(arm, samples=50).cost_matrix("energy").shape
        (20, 20)
        """
        if not isinstance(objective, str) or objective not in OBJECTIVES:
            raise InputError(f"objective: expected one of {', '.join(OBJECTIVES)}, got {objective!r}")
        return frozen(getattr(self, f"_{objective}"))

    def cost(self, objective: str, parameters: ArrayLike | None = None) -> float:
        """
        Compute a cost of the motion, a root mean square over the states.

        Parameters
        ----------
        objective : {"energy", "torque", "coupling", "components"}
            Energy about its mean in J ("energy", and "components" by the essential space); torques as fractions of
            their limits, squares summed over joints; or the mass matrix's entries off the diagonal in kg m^2.
        parameters : array_like, optional
            Inertial parameters (P,) in SI units; the mechanism's own by default.

        Returns
        -------
        float
            Cost in the objective's unit.

        Raises
        ------
        InputError
            If the objective is unknown or the shape is wrong.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> task = DesignTask.within_limits(arm, samples=20)
        >>> round(task.cost("energy", 2.0 * task.parameters) / task.cost("energy"), 6)
        2.0
        """
        return float(np.linalg.norm(self._applied(self.cost_matrix(objective), parameters)))

    def torques(self, parameters: ArrayLike | None = None) -> Array:
        """
        Compute the root mean square torques over the states, without friction.

        Parameters
        ----------
        parameters : array_like, optional
            Inertial parameters (P,) in SI units; the mechanism's own by default.

        Returns
        -------
        numpy.ndarray
            Torques (r,) in N m, or forces in N for a prismatic joint.

        Raises
        ------
        InputError
            If the shape is wrong.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> task = DesignTask.within_limits(arm, samples=20)
        >>> bool(np.allclose(task.torques(2.0 * task.parameters), 2.0 * task.torques()))
        True
        """
        return np.linalg.norm(self._applied(self._joint_torques, parameters), axis=-1)

    def components(self, percent: float, parameters: ArrayLike | None = None) -> int:
        """
        Count the essential components that keep the energy within an error.

        Parameters
        ----------
        percent : float
            Largest error of the root mean square energy in percent (Sheu and Walker 1991, equation 23).
        parameters : array_like, optional
            Inertial parameters (P,) in SI units; the mechanism's own by default.

        Returns
        -------
        int
            Smallest number of essential components.

        Raises
        ------
        InputError
            If the percentage is negative or not finite, or the shape is wrong.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> DesignTask.within_limits(arm, samples=50).components(100.0)
        0
        """
        return int(component_counts(self._applied(self._components, parameters), percent))

    def nonzero_parameters(
        self, parameters: ArrayLike | None = None, share: float = MIN_ENERGY_SHARE
    ) -> tuple[str, ...]:
        """
        Return the base parameters that contribute to the energy.

        Parameters
        ----------
        parameters : array_like, optional
            Inertial parameters (P,) in SI units; the mechanism's own by default.
        share : float, default 1e-6
            Fraction of the energy, without unit, above which a parameter counts. 1e-6 is above round-off.

        Returns
        -------
        tuple of str
            Names in the order of `basis`.

        Raises
        ------
        InputError
            If the energy is constant, the shape is wrong, or the fraction is no number.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> task = DesignTask.within_limits(arm, samples=20)
        >>> task.nonzero_parameters(share=0.1)
        ('upper.mc_x', 'lower.mc_x')
        """
        if math.isnan(real_number(share, "task: share")):
            raise InputError("task: share: expected a number, got nan")
        return tuple(
            name
            for name, weight in zip(self.basis.names, self.energy_fractions(parameters), strict=True)
            if weight > share
        )

    def energy_fractions(self, parameters: ArrayLike | None = None) -> Array:
        """
        Compute the root mean square energy due to each base parameter, divided by the whole.

        Parameters
        ----------
        parameters : array_like, optional
            Inertial parameters (P,) in SI units; the mechanism's own by default.

        Returns
        -------
        numpy.ndarray
            Fractions (k,) in the order of `basis`, which need not sum to 1.

        Raises
        ------
        InputError
            If the energy is constant or the shape is wrong.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> task = DesignTask.within_limits(arm, samples=20)
        >>> task.energy_fractions().shape == (task.basis.rank,)
        True
        """
        self.validate_energy(parameters)
        D = self._given(parameters)
        each = np.linalg.norm(self._energy[:, list(self.basis.columns)], axis=0)
        return each * np.abs(self.basis.regrouping @ D) / self.cost("energy", D)

    def link_index(self, name: str) -> int:
        """
        Return the index of a link among those that own inertial parameters.

        Parameters
        ----------
        name : str
            Name of the link.

        Returns
        -------
        int
            Index from 0.

        Raises
        ------
        InputError
            If no such link has this name.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> task = DesignTask.within_limits(arm, samples=20)
        >>> task.link_index("lower")
        1
        """
        names = self.mechanism.description.body_names
        if name not in names:
            raise InputError(f"{self.mechanism.name}: no link {name!r} with inertia; links: {', '.join(names)}")
        return names.index(name)

    def center_of_mass(self, link: str) -> Array:
        """
        Return the center of mass of a link.

        Parameters
        ----------
        link : str
            Link by name, as in `mechanism.links`.

        Returns
        -------
        numpy.ndarray
            Position (3,) in the link's frame in m; the origin for a massless link.

        Raises
        ------
        InputError
            If the link is unknown.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> task = DesignTask.within_limits(arm, samples=20)
        >>> task.center_of_mass("lower").shape
        (3,)
        """
        ten = self.parameters[10 * self.link_index(link) :][:4]
        return np.asarray(ten[1:4] / ten[0]) if ten[0] > 0.0 else np.zeros(3)

    def with_parameters(self, parameters: ArrayLike) -> DesignTask:
        """
        Return the same states of the mechanism with other inertial parameters.

        Parameters
        ----------
        parameters : array_like
            Inertial parameters (P,) in SI units, without friction.

        Returns
        -------
        DesignTask
            Task of the changed mechanism.

        Raises
        ------
        InputError
            If the shape is wrong, a size is above 1e20, or a rotor inertia is negative.

        Examples
        --------
        >>> from adaptctl.design import DesignTask
        >>> task = DesignTask.within_limits(arm, samples=50)
        >>> round(task.with_parameters(2.0 * task.parameters).cost("energy") / task.cost("energy"), 6)
        2.0
        """
        own = np.array(self.mechanism.inertial_parameters)
        own[: self.mechanism.num_energy_parameters] = self._given(parameters)
        return replace(self, mechanism=self.mechanism.with_parameters(own))

    def _given(self, parameters: ArrayLike | None) -> Array:
        D = self.parameters if parameters is None else checked(parameters, len(self.parameters), "parameters")
        if D.ndim > 1:
            raise InputError(f"parameters: expected shape {self.parameters.shape}, got {D.shape}")
        return D

    def _applied(self, matrix: Array, parameters: ArrayLike | None) -> Array:
        """M D (..., n). Raises `NonFiniteError` for overflow."""
        with np.errstate(over="ignore", invalid="ignore"):
            values = np.asarray(matrix @ self._given(parameters))
            if not np.isfinite(np.sum(np.square(values))):
                raise NonFiniteError("parameters: the cost overflows; give smaller parameters, or lower velocities")
        return values

    @cached_property
    def _energy(self) -> Array:
        values = energies(self.mechanism, States(self.p, self.v, self.origin))
        return triangle(values - values.mean(axis=0)) / np.sqrt(len(values))

    @cached_property
    def _components(self) -> Array:
        return self.essential_space.singular_values[: self.essential_space.rank, None] * self.essential_space.basis.T

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
    """Smallest numbers (...) of essential components within an energy error."""
    percent = finite_number(percent, "percent")
    squares = np.sort(np.square(weights), axis=-1)
    tails = np.cumsum(squares, axis=-1)
    return np.sum(tails > min(percent / 100.0, 1.0) ** 2 * tails[..., -1:], axis=-1)
