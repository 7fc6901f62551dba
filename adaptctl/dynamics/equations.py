"""The interface of equations of motion over scalars."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from adaptctl.caching import cached_property
from adaptctl.dynamics.motion import Motion, MotionMemory, Torques
from adaptctl.dynamics.recursion.mass_matrix import factorised
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.scalars import Column, Scalar


class Equations(ABC):
    """
    Equations of motion on scalars of any kind: floats, arrays of samples, dual numbers, symbolic scalars.

    Abstract; `Mechanism.equations` has them. There are r primary (independent) joints with positions p, n joints of the
    spanning tree with positions q, and P parameters. Arguments are not checked.

    Notes
    -----
    No code branches on a value. Vectors too short raise ``IndexError`` or ``ValueError``; singular systems raise
    ``ZeroDivisionError`` in floats.

    Examples
    --------
    >>> from adaptctl.scalars import Column, Dual
    >>> E = arm.equations.energy_regressor(Column([Dual(0.3, 1.0), 0.5]), Column([0.0, 0.0]))
    >>> gravity = sum(e.slope * d for e, d in zip(E, arm.inertial_parameters) if isinstance(e, Dual))
    >>> bool(np.isclose(gravity, arm.inverse_dynamics(p, 0.0 * p, 0.0 * p)[0]))
    True
    """

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number r of primary joints."""

    @property
    @abstractmethod
    def links(self) -> tuple[Segment, ...]:
        """Geometry of the tree's n links, lengths in m."""

    @property
    def num_joints(self) -> int:
        """Number n of the tree's joints."""
        return len(self.links)

    @property
    @abstractmethod
    def parameters(self) -> int:
        """Number P of parameters; with linear constraints, of free parameters."""

    @property
    def has_constraint_bias(self) -> bool:
        """True if linear constraints fix parameters at nonzero values, whose torque the regressors leave out."""
        return False

    @property
    def closure_key(self) -> object:
        """Values that a compiled closure of the loops depends on; None for a tree."""
        return None

    @abstractmethod
    def closed(self, p: Column, guess: Column) -> Column:
        """
        Compute the positions of all joints of the tree with loops closed.

        Parameters
        ----------
        p : Column
            Positions (r,) of the primary joints in rad (m if prismatic).
        guess : Column
            Positions (n,) of the tree's joints in rad (m), with loops closed on the assembly branch to stay on, near
            the solution.

        Returns
        -------
        Column
            Positions (n,) in rad (m), in closed form or by three Newton steps, which are exact to round-off from a
            guess within 0.05 rad.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> list(arm.equations.closed(column([0.3, 0.5]), column([0.0, 0.0])))  # a tree has no loops to close
        [0.3, 0.5]
        """

    @abstractmethod
    def nearest_closed(self, q: Column) -> Column:
        """
        Compute the configuration with loops closed that is near a given one.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), with loops nearly closed.

        Returns
        -------
        Column
            Positions (n,) in rad (m) with the same primary positions, in closed form or by one Newton step.
        """

    @abstractmethod
    def joint_velocities(self, q: Column, v: Column) -> Column:
        """
        Compute the velocities of all joints of the tree.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), which satisfy the loop closures.
        v : Column
            Velocities (r,) of the primary joints in rad/s (m/s if prismatic).

        Returns
        -------
        Column
            Velocities J v (n,) in rad/s (m/s), with the Jacobian J of q with respect to the primary positions.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> list(arm.equations.joint_velocities(column([0.3, 0.5]), column([1.0, 2.0])))  # those of a tree are primary
        [1.0, 2.0]
        """

    @abstractmethod
    def energy_regressor(self, q: Column, v: Column) -> Column:
        """
        Compute the regressor of the energy.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), which satisfy the loop closures.
        v : Column
            Velocities (r,) of the primary joints in rad/s (m/s if prismatic).

        Returns
        -------
        Column
            Regressor (P,) in J per unit of each parameter; the potential energy is zero at the ground frame's origin.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> energies = arm.equations.energy_regressor(column(p), column(v))
        >>> bool(np.isclose(energies @ column(arm.inertial_parameters), arm.energy(p, v)))
        True
        """

    @abstractmethod
    def potential_regressor(self, q: Column) -> Column:
        """
        Compute the regressor of the potential energy.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), which satisfy the loop closures.

        Returns
        -------
        Column
            Regressor (P,) in J per unit of each parameter; the energy is zero at the ground frame's origin.
        """

    @abstractmethod
    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column, v_f: Column | None = None) -> Motion:
        """
        Compute the kinematics at one instant, from which torques and regressors follow.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), which satisfy the loop closures.
        v, v_r, a_r : Column
            Velocities, Slotine and Li's reference velocities (rad/s) and reference accelerations (rad/s^2) of the
            primary joints, each (r,); m in place of rad for prismatic joints.
        v_f : Column, optional
            Velocities (r,) of the primary joints at which friction acts in rad/s (m/s). Default: v_r.

        Returns
        -------
        Motion
            Kinematics of the links.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> motion = arm.equations.motion(column(p), column(v), column(v), column([1.0, 2.0]))
        >>> torque = motion.torque(column(arm.inertial_parameters))
        >>> bool(np.allclose(list(torque), arm.inverse_dynamics(p, v, [1.0, 2.0])))
        True
        """

    @abstractmethod
    def momenta(self, q: Column, v: Column, v_f: Column | None = None) -> tuple[Torques, Torques]:
        """
        Compute the momenta and the forces of Lagrange's equations, which need no accelerations.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), which satisfy the loop closures.
        v : Column
            Velocities (r,) of the primary joints in rad/s (m/s if prismatic).
        v_f : Column, optional
            Velocities (r,) at which friction acts. Default: v.

        Returns
        -------
        tuple of Torques
            Momenta M v (r,) in N m s (N s if prismatic), and forces (r,) in N m (N): the Lagrangian's derivatives by
            the primary positions less friction. Momenta change by these forces and the joints' torques.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> momentum, forces = arm.equations.momenta(column(p), column(v))
        >>> bool(np.allclose(list(momentum.torque(column(arm.inertial_parameters))), arm.mass_matrix(p) @ v))
        True
        """

    @abstractmethod
    def restored_motion(self, numbers: Column) -> Motion:
        """
        Rebuild a motion from its stored numbers, without sines and the recursion over links.

        Parameters
        ----------
        numbers : Column
            Scalars (m,) in SI units, the property `numbers` of a `Motion`.

        Returns
        -------
        Motion
            Motion with these numbers.
        """

    @cached_property
    def motion_memory(self) -> MotionMemory:
        """Selection of a motion's numbers that a controller stores, without constants and repetitions."""
        sizes = {"q": self.num_joints, "v": self.dof, "v_r": self.dof, "a_r": self.dof}
        return MotionMemory.of(lambda q, v, v_r, a_r: self.motion(q, v, v_r, a_r).numbers, sizes)

    @abstractmethod
    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """
        Compute the mass matrix of the primary joints, with rotor inertias.

        Parameters
        ----------
        q : Column
            Positions (n,) of all n joints of the spanning tree in rad (m if prismatic), which satisfy the loop
            closures.
        parameters : Column
            All P inertial and friction parameters of the mechanism, in SI units.

        Returns
        -------
        list of list
            Rows of the matrix (r, r) for the r primary joints in kg m^2 (kg between prismatic joints, kg m between a
            revolute and a prismatic joint).

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> rows = arm.equations.mass_matrix(column(p), column(arm.inertial_parameters))
        >>> bool(np.allclose([list(row) for row in rows], arm.mass_matrix(p)))
        True
        """

    @abstractmethod
    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """
        Compute the damping matrix B, with which the velocity-dependent friction is B v.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), which satisfy the loop closures.
        v : Column
            Velocities (r,) of the primary joints in rad/s (m/s if prismatic).
        parameters : Column
            Inertial and friction parameters (P,) in SI units.

        Returns
        -------
        list of list
            Rows of the symmetric matrix (r, r) in N m s/rad (N s/m): friction divided by velocity.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> from adaptctl.description.drive import Drive
        >>> robot = arm.with_drives(Drive(viscous=0.1))
        >>> robot.equations.damping(column(p), column(v), column(robot.inertial_parameters))
        [[0.1, 0.0], [0.0, 0.1]]
        """

    @abstractmethod
    def without_gravity(self) -> Equations:
        """
        Return a copy of these equations without gravity.

        Returns
        -------
        Equations
            Equations without gravity's torque and potential energy.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> still = column([0.0, 0.0])
        >>> list(arm.equations.without_gravity().potential_regressor(still)) == [0.0] * 20
        True
        """

    def torque_regressor(self, q: Column, v: Column, v_r: Column, a_r: Column, columns: Sequence[int]) -> list[Column]:
        """
        Compute the Slotine-Li regressor for reference velocities and accelerations.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), which satisfy the loop closures.
        v, v_r, a_r : Column
            Velocities, reference velocities (rad/s) and reference accelerations (rad/s^2) of the primary joints, each
            (r,); m in place of rad for prismatic joints.
        columns : sequence of int
            Indices of the k parameters, from 0 to P - 1; negative ones are not refused.

        Returns
        -------
        list of Column
            Rows (k,) of the regressor (r, k) in N m (N if prismatic) per unit of each parameter.

        Raises
        ------
        IndexError
            If an index is P or more.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> rows = arm.equations.torque_regressor(column(p), column(v), column(v), column([0.0, 0.0]), [0, 9])
        >>> len(rows), len(rows[0])
        (2, 2)
        """
        return self.motion(q, v, v_r, a_r).regressor(columns)

    def inverse_dynamics(self, q: Column, v: Column, v_r: Column, a_r: Column, parameters: Column) -> Column:
        """
        Compute the torque for reference velocities and accelerations, with gravity and friction.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), which satisfy the loop closures.
        v, v_r, a_r : Column
            Velocities, reference velocities (rad/s) and reference accelerations (rad/s^2) of the primary joints, each
            (r,); m in place of rad for prismatic joints.
        parameters : Column
            Inertial and friction parameters (P,) in SI units.

        Returns
        -------
        Column
            Torque (r,) in N m (N if prismatic).

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> q, rates, D = column(p), column(v), column(arm.inertial_parameters)
        >>> torque = arm.equations.inverse_dynamics(q, rates, rates, column([1.0, 2.0]), D)
        >>> bool(np.allclose(list(torque), arm.inverse_dynamics(p, v, [1.0, 2.0])))
        True
        """
        return self.motion(q, v, v_r, a_r).torque(parameters)

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """
        Compute the accelerations under a torque, gravity and friction.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), which satisfy the loop closures.
        v : Column
            Velocities (r,) of the primary joints in rad/s (m/s if prismatic).
        torque : Column
            Torque (r,) in N m (N if prismatic).
        parameters : Column
            Inertial and friction parameters (P,) in SI units.

        Returns
        -------
        Column
            Accelerations (r,) in rad/s^2 (m/s^2).

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> torque, D = column([5.0, 1.0]), column(arm.inertial_parameters)
        >>> a = arm.equations.forward_dynamics(column(p), column(v), torque, D)
        >>> bool(np.allclose(list(a), arm.forward_dynamics(p, v, [5.0, 1.0])))
        True
        """
        inertia = factorised(self.mass_matrix(q, parameters))  # first: its divisions wait for each other
        bias = self.inverse_dynamics(q, v, v, Column.zeros(self.dof), parameters)
        return inertia.solved(torque - bias)

    def damped_dynamics(
        self, q: Column, v: Column, torque: Column, parameters: Column, dt: float,
        more: Callable[[Column], tuple[Column, Column]],
    ) -> Column:  # fmt: skip
        """
        Compute the accelerations for a time step with linearly implicit friction, which is stable for stiff friction.

        Parameters
        ----------
        q : Column
            Positions (n,) of the tree's joints in rad (m if prismatic), which satisfy the loop closures.
        v : Column
            Velocities (r,) of the primary joints in rad/s (m/s if prismatic).
        torque : Column
            Torque (r,) in N m (N if prismatic).
        parameters : Column
            Inertial and friction parameters (P,) in SI units.
        dt : float
            Time step in s.
        more : callable
            Function from velocities (r,) near those of the step's end to torques (r,) in N m (N) and slopes (r,) in
            N m s/rad (N s/m) of further friction, which is the torques plus the slopes times the velocities.

        Returns
        -------
        Column
            Accelerations a (r,) in rad/s^2 (m/s^2) with (M + dt B) a = torque - C v - g - B v - f, where `damping`
            gives B, and `more` f and its part of B, at the velocities that the same at v would end at: a slope of
            before a step would overrate Coulomb friction that accelerates.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> D = column(arm.inertial_parameters)
        >>> still = column([0.0, 0.0])
        >>> a = arm.equations.damped_dynamics(column(p), column(v), still, D, 1e-9, lambda v: (still, still))
        >>> bool(np.allclose(list(a), arm.forward_dynamics(p, v, [0.0, 0.0])))
        True
        """
        rows, own = self.mass_matrix(q, parameters), self.damping(q, v, parameters)
        free = torque - self.inverse_dynamics(q, v, v, Column.zeros(self.dof), parameters) + _product(own, v)

        def slowed(damping: list[list[Scalar]], speed: Column) -> Column:
            held, slopes = more(speed)
            for i, slope in enumerate(slopes):
                damping[i][i] = damping[i][i] + slope
            pairs = (zip(row, damped, strict=True) for row, damped in zip(rows, damping, strict=True))
            inertia = factorised([[_damped(m, b, dt) for m, b in pair] for pair in pairs])
            return inertia.solved(free - held - _product(damping, v))

        first = v + dt * slowed(own, v)
        return slowed(self.damping(q, first, parameters), first)


def _product(rows: list[list[Scalar]], v: Column) -> Column:
    return Column(Column(row) @ v for row in rows)


def _damped(inertia: Scalar, damping: Scalar, dt: float) -> Scalar:
    return inertia if isinstance(damping, float) and damping == 0.0 else inertia + dt * damping


class ClosedPositions(Column):
    """Primary positions with their closed configuration."""

    __slots__ = ("configuration", "equations")

    def __init__(self, positions: Column, configuration: Column, equations: Equations) -> None:
        super().__init__(positions)
        self.configuration, self.equations = configuration, equations
