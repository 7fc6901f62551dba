"""A mechanism: its description and equations, on arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, finite_results, frozen, frozen_array, same_samples
from adaptctl.caching import cached_property
from adaptctl.description import Description, Joint, Link
from adaptctl.description.drive import Drive
from adaptctl.dynamics.array_equations import ArrayEquations
from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.parameter_layout import required_columns
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.errors import InputError, LoopError, validate_kind
from adaptctl.markup import table, titled
from adaptctl.optional_packages import needed

if TYPE_CHECKING:
    import mujoco
    import pinocchio

    from adaptctl.dynamics.array_equations import OnArrays
    from adaptctl.dynamics.loop_equations import LoopEquations
    from adaptctl.dynamics.loops.continuation import Continuation


class Mechanism:
    """
    Robot mechanism: energies, torques, accelerations and regressors on NumPy arrays.

    Arrays have one entry for each of r primary (independent) joints; leading axes are samples. Units are rad and N m,
    or m and N for prismatic joints. Methods raise `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity,
    and `SingularityError` near a singularity of the loops.

    Parameters
    ----------
    description : Description
        Links, joints and loops, as `read` returns them; `load` makes the mechanism at once.

    Raises
    ------
    InputError
        If `description` is not a `Description`.

    Notes
    -----
    An equation runs in native code after 50 calls or 25000 samples.

    Examples
    --------
    >>> arm
    <Mechanism 'two_link': 2 links, 2 degrees of freedom>
    >>> arm.forward_dynamics(p, v, torque=[0.0, 0.0]).shape
    (2,)
    >>> samples = rng.normal(size=(100, 2))
    >>> arm.mass_matrix(samples).shape
    (100, 2, 2)
    """

    def __init__(self, description: Description) -> None:
        validate_kind(description, Description, "mechanism", "as read(...) gives one; load(...) gives mechanisms")
        self.description = description

    def __repr__(self) -> str:
        return f"<Mechanism {self.name!r}: {len(self.links)} links, {self.dof} degrees of freedom>"

    def _repr_html_(self) -> str:
        heads = ("link", "parent", "joint", "kind", "limits", "effort", "mass [kg]")
        rows = [
            (
                link.name,
                self.links[link.parent].name if link.parent >= 0 else "ground",
                link.joint.name,
                link.joint.kind.value,
                f"{link.joint.limits.lower:.4g} to {link.joint.limits.upper:.4g}",
                f"{link.joint.limits.effort:.4g}",
                f"{link.inertia[0]:.4g}",
            )
            for link in self.links
        ]
        text = f"{len(self.links)} links, {self.dof} degrees of freedom, {len(self.parameter_names)} parameters"
        return titled(self.name, text) + table(heads, rows)

    @cached_property
    def _arrays(self) -> ArrayEquations:
        return ArrayEquations(self)

    @cached_property
    def equations(self) -> Equations:
        """Equations of motion on scalars (floats, dual numbers, symbolic scalars), without checks."""
        if self._looped is None:
            return TreeEquations.of(self.description)
        from adaptctl.dynamics.loops.dyad import rules

        stepped, reference = self._looped
        return replace(stepped, rules=rules(stepped.closing, stepped.tree.segments, reference))

    @cached_property
    def _looped(self) -> tuple[LoopEquations, Array] | None:
        loops = self.description.loops
        if loops is None:
            return None
        from adaptctl.dynamics.loop_equations import LoopEquations
        from adaptctl.dynamics.loops.assembly import assembled

        tree = TreeEquations.of(self.description)
        closing, reference = assembled(self.description, loops, tree.segments)
        return LoopEquations(tree, closing), reference

    @cached_property
    def continuation(self) -> Continuation | None:
        """Solver that follows the assembly branch of the reference configuration; None for a tree."""
        if self._looped is None:
            return None
        from adaptctl.dynamics.loops.continuation import Continuation

        return Continuation(*self._looped)

    @property
    def neutral_configuration(self) -> Array:
        """Positions (r,) of the reference configuration in rad (m if prismatic); zeros for a tree."""
        loops = self.continuation
        return np.zeros(self.dof) if loops is None else loops.reference[loops.primary]

    def configuration(self, p: ArrayLike, start: ArrayLike | None = None) -> Array:
        """
        Compute the positions of all joints of the tree with loops closed.

        Parameters
        ----------
        p : array_like
            Positions (..., r) of the primary joints in rad (m if prismatic).
        start : array_like, optional
            Closed configuration (..., n) in rad (m) from which the loops are followed along straight lines in p; by
            default the reference configuration.

        Returns
        -------
        ndarray
            Positions (..., n) of the tree's n joints; p itself for a tree.

        Raises
        ------
        SingularityError
            If the smallest singular value of the closure Jacobian falls below 0.05 of that at the reference
            configuration.

        Notes
        -----
        The closure equations are those of Sheu and Walker (1991, equation 1).

        Examples
        --------
        >>> arm.configuration([0.3, 0.5]).tolist()
        [0.3, 0.5]
        """
        loops = self.continuation
        if loops is not None and start is None and (known := loops.follow_alone(p)) is not None:
            return known
        p = checked(p, self.dof, f"{self.name}: p")
        begin = None if start is None else checked(start, len(self.links), f"{self.name}: start")
        return p if loops is None else loops.follow(p, begin)

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.description.name

    @property
    def dof(self) -> int:
        """Number r of degrees of freedom."""
        return len(self.description.primary)

    @property
    def links(self) -> tuple[Link, ...]:
        """Links of the tree, parents before children."""
        return self.description.links

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P parameters, such as `link3.I_xx`."""
        return self.description.parameter_names

    @cached_property
    def inertial_parameters(self) -> Array:
        """Values (P,) of all parameters in SI units, in the order of `parameter_names`."""
        return self.description.inertial_parameters

    @property
    def is_plain_tree(self) -> bool:
        """True without loops, couplings and constraints."""
        return self.description.loops is None

    @property
    def unconstrained(self) -> Mechanism:
        """This mechanism without linear constraints on its parameters."""
        return self

    @property
    def free_directions(self) -> Array:
        """Derivatives (P, Z) of all P parameters with respect to Z free ones; the identity without constraints."""
        return np.eye(len(self.parameter_names))

    @property
    def num_energy_parameters(self) -> int:
        """Number of parameters in the energy, which precede friction."""
        return self.description.num_energy_parameters

    @property
    def geometry_sha256(self) -> str:
        """SHA-256 hash (hexadecimal) of the data that decide which inertial parameters are identifiable."""
        return self.description.geometry_sha256

    @cached_property
    def effort_limits(self) -> Array:
        """Greatest torques (r,) in N m (N if prismatic); infinite if unknown."""
        return frozen(np.array([joint.limits.effort for joint in self.primary_joints]))

    @property
    def primary_joints(self) -> tuple[Joint, ...]:
        """Primary (independent) joints, in order."""
        return tuple(self.links[i].joint for i in self.description.primary)

    def with_parameters(self, parameters: ArrayLike) -> Mechanism:
        """
        Return a copy with other parameter values.

        Parameters
        ----------
        parameters : array_like
            Values (P,) in SI units, in the order of `parameter_names`.

        Returns
        -------
        Mechanism
            The copy; this mechanism stays as it is.

        Raises
        ------
        InputError
            If the number of values is wrong, one is not finite or above 1e20 in size, or a rotor inertia, viscous or
            Coulomb friction is negative.

        Examples
        --------
        >>> heavy = arm.with_parameters(1.5 * arm.inertial_parameters)
        >>> bool(np.allclose(heavy.mass_matrix(p), 1.5 * arm.mass_matrix(p)))
        True
        """
        return Mechanism(self.description.with_parameters(parameters))

    def locked(self, positions: Mapping[str, float | None] | Sequence[str]) -> Mechanism:
        """
        Return the mechanism with some joints held fast.

        Parameters
        ----------
        positions : mapping of str to float or None, or sequence of str
            Positions in rad (m if prismatic) by the names of the joints; None is zero. Or words such as "elbow=0.5",
            and "elbow" for zero.

        Returns
        -------
        Mechanism
            The mechanism of the other joints. Links behind locked joints are part of the links before them, and named
            frames there.

        Raises
        ------
        NotFoundError
            If there is no such joint.
        InputError
            If a position is not finite or outside the limits, no joint is left, or a joint that is not locked moves one
            that is.

        Examples
        --------
        >>> held = arm.locked({"elbow": 0.5})
        >>> held.dof, bool(held.links[0].inertia[0] == sum(link.inertia[0] for link in arm.links))
        (1, True)
        """
        from adaptctl.description.locking import held_positions, with_locked

        held = held_positions(self.description, positions)
        p = self.neutral_configuration.copy()
        for j, joint in enumerate(self.primary_joints):
            p[j] = held.get(joint.name, p[j])
        return Mechanism(with_locked(self.description, held, self.configuration(p).tolist()))

    def column_regressor(self, regressor: str, columns: Sequence[int]) -> OnArrays:
        """
        Return a function that computes only some columns of a regressor.

        Parameters
        ----------
        regressor : str
            Name of the method, "torque_regressor" or "slotine_li_regressor".
        columns : sequence of int
            Indices, from 0 to P - 1, of the k parameters.

        Returns
        -------
        ArrayEquation
            Its method `call` takes the arguments of that regressor and returns the columns (..., r, k) in N m (N) per
            unit of each parameter.

        Raises
        ------
        InputError
            If the name is unknown or an index out of range.

        Examples
        --------
        >>> arm.column_regressor("torque_regressor", [0, 5, 9]).call(p, v, v).shape
        (2, 3)
        """
        asked = required_columns(columns, len(self.parameter_names), self.name)
        return self._arrays.on_columns(regressor, tuple(asked))

    def with_drives(self, drives: Drive | Sequence[Drive]) -> Mechanism:
        """
        Return a copy with other rotor inertias and joint friction.

        Parameters
        ----------
        drives : Drive or sequence of Drive
            Rotor inertia and friction of all n joints of the tree, or one drive for each in the order of `links`. Each
            term becomes a parameter; ``Drive()`` has none.

        Returns
        -------
        Mechanism
            The copy, with the same constraints on parameters.

        Raises
        ------
        InputError
            If the number of drives is wrong or a motor turns with a joint that does not exist.

        Examples
        --------
        >>> from adaptctl.description.drive import Drive
        >>> arm.with_drives(Drive(viscous=0.1)).parameter_names[-2:]
        ('shoulder.viscous', 'elbow.viscous')
        """
        return Mechanism(self.description.with_drives(drives))

    def energy_regressor(self, p: ArrayLike, v: ArrayLike, out: Array | None = None) -> Array:
        """
        Compute the regressor of the energy.

        Parameters
        ----------
        p, v : array_like
            Positions and velocities (..., r) in rad and rad/s (m and m/s if prismatic).
        out : ndarray, optional
            Array (..., P) of float64 to fill in J per unit of each parameter. Default: a new one; a given one saves its
            allocation.

        Returns
        -------
        ndarray
            Regressor E (..., P) in J per unit of each parameter.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Notes
        -----
        :math:`E D = T + U` for parameters D, with kinetic energy T and potential energy U, zero at the ground frame's
        origin (Sheu and Walker 1991, section 2.2).

        Examples
        --------
        >>> bool(np.allclose(arm.energy_regressor(p, v) @ arm.inertial_parameters, arm.energy(p, v)))
        True
        """
        if out is None:
            return self._arrays.energy_regressor.call(p, v)
        return self._arrays.energy_regressor.into(out, p, v)

    @finite_results
    def energy(self, p: ArrayLike, v: ArrayLike) -> Array:
        """
        Compute the kinetic plus potential energy.

        Parameters
        ----------
        p, v : array_like
            Positions and velocities (..., r) in rad and rad/s (m and m/s if prismatic).

        Returns
        -------
        ndarray
            Energy (...) in J; its potential part is zero at the ground frame's origin.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Examples
        --------
        >>> arm.energy(np.zeros((5, 2)), np.zeros((5, 2))).shape
        (5,)
        """
        return self.energy_regressor(p, v) @ self.inertial_parameters

    def torque_regressor(
        self,
        p: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        columns: Sequence[int] | None = None,
        out: Array | None = None,
    ) -> Array:
        r"""
        Compute the regressor of the torque, which is linear in the parameters.

        Parameters
        ----------
        p, v, a : array_like
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic).
        columns : sequence of int, optional
            Indices of the k parameters; all P by default.
        out : ndarray, optional
            Array of float64 to fill, of the result's shape; a new one by default.

        Returns
        -------
        ndarray
            Regressor Y (..., r, P), or (..., r, k), in N m (N) per unit of each parameter.

        Raises
        ------
        InputError
            If a shape or an index is wrong.

        Notes
        -----
        :math:`Y(p, v, a) D = \tau` for parameters D, gravity and friction included.

        Examples
        --------
        >>> Y = arm.torque_regressor(p, v, [0.0, 1.0])
        >>> bool(np.allclose(Y @ arm.inertial_parameters, arm.inverse_dynamics(p, v, [0.0, 1.0])))
        True
        """
        own = self._arrays.torque_regressor
        equation = own if columns is None else self.column_regressor("torque_regressor", columns)
        return equation.call(p, v, a) if out is None else equation.into(out, p, v, a)

    def slotine_li_regressor(
        self,
        p: ArrayLike,
        v: ArrayLike,
        v_r: ArrayLike,
        a_r: ArrayLike,
        columns: Sequence[int] | None = None,
        out: Array | None = None,
    ) -> Array:
        r"""
        Compute the regressor of Slotine and Li's adaptive law.

        Parameters
        ----------
        p, v : array_like
            Positions and velocities (..., r) in rad and rad/s (m and m/s if prismatic).
        v_r, a_r : array_like
            Reference velocities and accelerations (..., r) in rad/s and rad/s^2 (m/s and m/s^2).
        columns : sequence of int, optional
            Indices of the k parameters; all P by default.
        out : ndarray, optional
            Array of float64 to fill, of the result's shape; a new one by default.

        Returns
        -------
        ndarray
            Regressor Y_r (..., r, P), or (..., r, k), in N m (N) per unit of each parameter.

        Raises
        ------
        InputError
            If a shape or an index is wrong.

        Notes
        -----
        .. math:: Y_r D = M(p)\, a_r + C(p, v)\, v_r + g(p) + f(v_r)

        with parameters D, mass matrix M, Coriolis matrix C by Christoffel symbols, gravity g and friction f.

        Examples
        --------
        >>> arm.slotine_li_regressor(p, v, v, [0.0, 0.0], columns=[0, 1, 9]).shape
        (2, 3)
        """
        own = self._arrays.slotine_li_regressor
        equation = own if columns is None else self.column_regressor("slotine_li_regressor", columns)
        return equation.call(p, v, v_r, a_r) if out is None else equation.into(out, p, v, v_r, a_r)

    def inverse_dynamics(self, p: ArrayLike, v: ArrayLike, a: ArrayLike, out: Array | None = None) -> Array:
        """
        Compute the torque that gives an acceleration, against inertia, gravity and friction.

        Parameters
        ----------
        p, v, a : array_like
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic).
        out : ndarray, optional
            Array (..., r) of float64 to fill in N m (N). Default: a new one; a given one saves its allocation.

        Returns
        -------
        ndarray
            Torque (..., r) in N m (N if prismatic).

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Examples
        --------
        >>> torque = arm.inverse_dynamics(p, v, [1.0, 2.0])
        >>> bool(np.allclose(arm.forward_dynamics(p, v, torque), [1.0, 2.0]))
        True
        """
        if out is None:
            return self._arrays.inverse_dynamics.call(p, v, a, self.inertial_parameters)
        return self._arrays.inverse_dynamics.into(out, p, v, a, self.inertial_parameters)

    def constraint_bias_torque(self, p: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """
        Compute the torque due to the parameter values that linear constraints fix.

        Parameters
        ----------
        p, v, a : array_like
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic).

        Returns
        -------
        ndarray
            Torque (..., r) in N m (N if prismatic), which regressors leave out; zero without constraints.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Examples
        --------
        >>> arm.constraint_bias_torque(p, v, v).tolist()
        [0.0, 0.0]
        """
        given = {"p": p, "v": v, "a": a}
        samples = same_samples(**{what: checked(x, self.dof, f"{self.name}: {what}") for what, x in given.items()})
        return np.zeros((*samples, self.dof))

    def forward_dynamics(self, p: ArrayLike, v: ArrayLike, torque: ArrayLike, out: Array | None = None) -> Array:
        """
        Compute the acceleration under a torque, gravity and friction.

        Parameters
        ----------
        p, v : array_like
            Positions and velocities (..., r) in rad and rad/s (m and m/s if prismatic).
        torque : array_like
            Torque (..., r) in N m (N if prismatic).
        out : ndarray, optional
            Array (..., r) of float64 to fill in rad/s^2 (m/s^2). Default: a new one; a given one saves its allocation.

        Returns
        -------
        ndarray
            Accelerations (..., r) in rad/s^2 (m/s^2).

        Raises
        ------
        InputError
            If a shape is wrong, or if end links of a tree have neither mass nor rotor.

        Examples
        --------
        >>> arm.forward_dynamics(p, v, [5.0, 1.0]).shape
        (2,)
        """
        if out is None:
            return self._arrays.forward_dynamics.call(p, v, torque, self.inertial_parameters)
        return self._arrays.forward_dynamics.into(out, p, v, torque, self.inertial_parameters)

    def validate_mass(self) -> None:
        """
        Check that torques determine the acceleration of every joint.

        Raises
        ------
        InputError
            If a link of a tree has neither inertia nor rotor, nor a descendant with either; the message names it.
            Mechanisms with loops pass.
        """
        if self.description.massless_joints:
            names = ", ".join(self.description.massless_joints)
            raise InputError(f"{self.name}: links and all that they carry have no mass; give mass to {names}")

    def mass_matrix(self, p: ArrayLike, out: Array | None = None) -> Array:
        """
        Compute the symmetric mass matrix, with rotor inertias.

        Parameters
        ----------
        p : array_like
            Positions (..., r) in rad (m if prismatic).
        out : ndarray, optional
            Array (..., r, r) of float64 to fill in kg m^2 (kg). Default: a new one; a given one saves its allocation.

        Returns
        -------
        ndarray
            Mass matrix (..., r, r) in kg m^2 (kg between prismatic joints, kg m between different ones).

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Examples
        --------
        >>> M = arm.mass_matrix(p)
        >>> bool(np.all(np.linalg.eigvalsh(M) > 0.0))
        True
        """
        if out is None:
            return self._arrays.mass_matrix.call(p, self.inertial_parameters)
        return self._arrays.mass_matrix.into(out, p, self.inertial_parameters)

    @needed("Mechanism.to_pinocchio")
    def to_pinocchio(self) -> pinocchio.Model:
        """
        Return a Pinocchio model of the spanning tree, without loop closures.

        Returns
        -------
        pinocchio.Model
            Model with the same joints in the same order.

        Raises
        ------
        InputError
            If a link has a first moment without mass or a drive turns with several joints.
        MissingExtraError
            If Pinocchio is not installed.

        Warns
        -----
        SimplificationWarning
            If springs, or friction other than viscous and Coulomb's, are left out.

        Examples
        --------
        >>> arm.to_pinocchio().nv
        2
        """
        from adaptctl.description.readers.pinocchio_model import to_pinocchio

        return to_pinocchio(self.description)

    @needed("Mechanism.to_pinocchio_constraints")
    def to_pinocchio_constraints(self) -> list[pinocchio.RigidConstraintModel]:
        """
        Return Pinocchio's constraint models of the loop closures.

        Returns
        -------
        list of pinocchio.RigidConstraintModel
            Constraints on the model that `to_pinocchio` returns; empty for a tree.

        Raises
        ------
        InputError
            If joints follow others (couplings), a link has a first moment without mass, or a drive turns with several
            joints.
        MissingExtraError
            If Pinocchio is not installed.

        Examples
        --------
        >>> arm.to_pinocchio_constraints()  # a tree has no loops
        []
        """
        from adaptctl.description.readers.pinocchio_model import to_pinocchio_constraints

        return to_pinocchio_constraints(self.description, self.to_pinocchio())

    @classmethod
    @needed("Mechanism.from_pinocchio")
    def from_pinocchio(cls, model: pinocchio.Model) -> Mechanism:
        """
        Return the mechanism of a Pinocchio model.

        Parameters
        ----------
        model : pinocchio.Model
            Model of revolute and prismatic joints. They are put in depth-first order: look them up by name.

        Returns
        -------
        Mechanism
            The mechanism, with the model's inertias, limits and gravity.

        Raises
        ------
        InputError
            If a joint is neither revolute nor prismatic, there are no joints, or gravity has an angular part.
        MissingExtraError
            If Pinocchio is not installed.

        Warns
        -----
        SimplificationWarning
            If limits are zero, which are taken as no limits.

        Examples
        --------
        >>> adaptctl.Mechanism.from_pinocchio(arm.to_pinocchio()).dof
        2
        """
        from adaptctl.description.readers.pinocchio_model import from_pinocchio

        return cls(from_pinocchio(model))

    def write_into(self, original: str | Path, path: str | Path, root: str | None = None) -> None:
        """
        Write a copy of a URDF or MJCF file with the inertias of this mechanism.

        Parameters
        ----------
        original : str or Path
            File of the same mechanism. All but the inertias, drives included, stays byte for byte.
        path : str or Path
            File to write.
        root : str, optional
            Name of the body of an MJCF scene at which the mechanism begins. Default: the only root body that moves.

        Raises
        ------
        FileError
            If a file is of another mechanism, cannot be read or written, or if inertias have no mass or, in MJCF,
            belong to no rigid body.
        InputError
            If the suffix is unknown or `root` is given for a URDF file.

        Examples
        --------
        >>> urdf = tmp / "arm.urdf"
        >>> _ = urdf.write_text('''<robot name="arm"><link name="base"/><link name="rod"><inertial><mass value="1"/>
        ... <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        ... <joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/></joint></robot>''')
        >>> rod = adaptctl.load(urdf)
        >>> rod.with_parameters(2.0 * rod.inertial_parameters).write_into(urdf, tmp / "heavy.urdf")
        >>> float(adaptctl.load(tmp / "heavy.urdf").inertial_parameters[0])
        2.0
        """
        from adaptctl.description.writers.robot_file import write_robot

        write_robot(path, original, self.description, root)

    def in_pinocchio(self, model: pinocchio.Model) -> pinocchio.Model:
        """
        Return a copy of a Pinocchio model with the inertias and drives of this mechanism.

        Parameters
        ----------
        model : pinocchio.Model
            Model with joints of the same names.

        Returns
        -------
        pinocchio.Model
            Copy with this mechanism's inertias, rotors (armature), viscous and Coulomb friction. Pinocchio's inverse
            dynamics leaves friction out.

        Raises
        ------
        InputError
            If the number of joints differs, a link has a first moment without mass, or a drive turns with several
            joints.
        NotFoundError
            If a joint is unknown.

        Warns
        -----
        SimplificationWarning
            If springs, or friction other than viscous and Coulomb's, are left out.

        Examples
        --------
        >>> heavy = arm.with_parameters(2.0 * arm.inertial_parameters)
        >>> model = heavy.in_pinocchio(arm.to_pinocchio())
        >>> bool(model.inertias[1].mass == heavy.inertial_parameters[0])
        True
        """
        from adaptctl.description.readers.pinocchio_model import with_inertias

        return with_inertias(model, self.description)

    @needed("Mechanism.to_mujoco")
    def to_mujoco(self) -> mujoco.MjModel:
        """
        Return a MuJoCo model of a tree, with a motor at each joint.

        Returns
        -------
        mujoco.MjModel
            Model whose controls are torques in N m (N if prismatic).

        Raises
        ------
        InputError
            If there are loops, drives that turn with several joints, inertias of no rigid body, or terms of drives
            other than a rotor, viscous and Coulomb friction and a linear spring of positive stiffness.
        MissingExtraError
            If MuJoCo is not installed.

        Examples
        --------
        >>> arm.to_mujoco().nu
        2
        """
        from adaptctl.description.writers.mujoco_model import to_mujoco

        return to_mujoco(self.description)

    @classmethod
    @needed("Mechanism.from_mujoco")
    def from_mujoco(cls, model: mujoco.MjModel, body: str | None = None) -> Mechanism:
        """
        Return the mechanism of a MuJoCo model, or of one body of a scene.

        Parameters
        ----------
        model : mujoco.MjModel
            Model of up to 256 moving links.
        body : str, optional
            Name of the body at which the mechanism begins. Default: the only root body with hinge or slide joints.

        Returns
        -------
        Mechanism
            That body with all its descendants.

        Raises
        ------
        InputError
            If there is no joint, a ball or free joint, nonlinear damping or equality, several moving roots without a
            `body`, or if `body` is attached to one that moves.
        NotFoundError
            If `body` is unknown.
        MissingExtraError
            If MuJoCo is not installed.

        Warns
        -----
        SimplificationWarning
            If springs or gravity compensation are left out, or actuators command no torque.

        Examples
        --------
        >>> adaptctl.Mechanism.from_mujoco(arm.to_mujoco()).dof
        2
        """
        from adaptctl.description.readers.mujoco_model import from_mujoco

        return cls(from_mujoco(model, body))


def load(
    source: str | Path | pinocchio.Model | mujoco.MjModel,
    *,
    floating_base: bool = False,
    as_written: bool = False,
    mesh_folders: Sequence[str | Path] = (),
    root: str | None = None,
    gravity: ArrayLike | None = None,
    lock: Mapping[str, float | None] | Sequence[str] = (),
) -> Mechanism:
    """
    Load a robot by name, from a file, or from a Pinocchio or MuJoCo model.

    Parameters
    ----------
    source : str, Path, pinocchio.Model or mujoco.MjModel
        Name of a built-in robot (``"puma560"``, see `builtin_names`), a file (.toml, .urdf, .xml, .mjcf), or a model.
    floating_base : bool, default False
        If true, the base floats on six joints: the root link of a URDF file, the root body of an MJCF file. By default
        it is held still, whatever the file says.
    as_written : bool, default False
        If true, all angles are meant as they stand. By default those between successive joint axes that are within
        1e-4 rad of a multiple of 90 degrees are taken as rounded and made exact, if torques change by less than 1e-4.
    mesh_folders : sequence of str or Path, optional
        Folders with meshes of a URDF file. Default: none besides its own package.
    root : str, optional
        Name of the body of an MJCF scene or MuJoCo model at which the mechanism begins. Default: the only root body
        that moves.
    gravity : array_like, optional
        Gravity (3,) in the frame of the robot's base in m/s^2, for a tilted mount. Default: the source's, which is
        (0, 0, -9.81) in URDF.
    lock : mapping of str to float or None, or sequence of str, optional
        Joints to hold fast, as `Mechanism.locked` takes them. Default: none.

    Returns
    -------
    Mechanism
        The mechanism, its loops closed at the reference configuration.

    Raises
    ------
    NotFoundError
        If the name, or the root of a model, is unknown.
    FileError
        If a file cannot be read or its contents are wrong.
    InputError
        If a model cannot be used, or an option does not go with the source.
    LoopError
        If the loops of a file cannot be closed.

    Warns
    -----
    PhysicalConsistencyWarning
        If a link has an inertia that no rigid body can have.
    RoundedAnglesWarning
        If rounded angles are taken as right angles.
    SimplificationWarning
        If a part of the source, such as springs, is left out.
    PlausibilityWarning
        If a link is denser than any material or beyond the robot's reach, or gravity exceeds a torque limit by 10 %
        at a posture within position limits.

    Examples
    --------
    >>> adaptctl.load("puma560_measured")
    <Mechanism 'puma560_measured': 6 links, 6 degrees of freedom>
    """
    from adaptctl.description.readers.registry import read, read_model
    from adaptctl.dynamics.plausibility import warn_of_implausible
    from adaptctl.dynamics.rounded_angles import as_meant

    options: dict[str, Any] = {"floating_base": floating_base, "mesh_folders": mesh_folders, "root": root}
    is_file = isinstance(source, str | Path)
    read_in = read(source, **options) if isinstance(source, str | Path) else read_model(source, **options)
    where = str(source) if is_file else read_in.name
    if gravity is not None:
        read_in = replace(read_in, gravity=frozen_array(gravity, (3,), "gravity"))
    mechanism = Mechanism(replace(read_in, as_written=True) if as_written else as_meant(read_in, where, stacklevel=2))
    if not is_file:
        return mechanism.locked(lock) if lock else mechanism
    try:
        mechanism = mechanism.locked(lock) if lock else mechanism
        _ = mechanism.continuation  # Closes the loops, so that a wrong file is named here and not later.
    except LoopError as error:
        raise LoopError(f"{source}: {error}") from error
    warn_of_implausible(mechanism, source)
    return mechanism
