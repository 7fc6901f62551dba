"""Robot mechanism, the public face of the equations, its variants, and its models in other packages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from adaptctl.description.drive import Drive
from adaptctl.dynamics.array_dynamics import ArrayDynamics
from adaptctl.optional_packages import needed

if TYPE_CHECKING:
    import mujoco
    import pinocchio


class Mechanism(ArrayDynamics):
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

    @property
    def unconstrained(self) -> Mechanism:
        """This mechanism without linear constraints on its parameters."""
        return self

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
