"""A mechanism: its description and its equations, on arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, finite_results, frozen, same_samples
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
    """A mechanism made from a `description`, with its energies, torques, regressors and accelerations on arrays.
    Positions p, velocities v, accelerations a, torques are (..., r), regressors (..., P) and (..., r, P), of r primary
    (independent) joints and P inertial and friction parameters; leading axes are samples. SI units: rad, N m (m, N if
    prismatic). Equations run in Python for 50 calls or 25000 samples, then natively. Methods raise `InputError` on a
    wrong shape, `NonFiniteError` on NaN or infinity, `LoopError` where loops cannot be closed, and `SingularityError`
    near singularities of loops, where their smallest singular value is below 0.05 of that at the reference
    configuration; construction raises `InputError` for what is no `Description`."""

    def __init__(self, description: Description) -> None:
        validate_kind(description, Description, "mechanism", "as read(...) gives one; load(...) gives mechanisms")
        self.description = description

    def __repr__(self) -> str:
        return f"<Mechanism {self.name!r}: {len(self.links)} links, {self.dof} degrees of freedom>"

    def _repr_html_(self) -> str:
        """Notebook's view of the mechanism: a table with a row a link."""
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
        """The equations of motion over scalars of any kind (floats, arrays, dual numbers, symbolic ones), an
        `Equations`, to trace or differentiate; they check nothing. Raises `LoopError` where loops cannot be closed."""
        if self._looped is None:
            return TreeEquations.of(self.description)
        from adaptctl.dynamics.loops.dyad import rules

        stepped, reference = self._looped
        return replace(stepped, rules=rules(stepped.closing, stepped.tree.segments, reference))

    @cached_property
    def _looped(self) -> tuple[LoopEquations, Array] | None:
        """The equations with loops, closed by Newton's steps, and the closed reference (n,); None for a tree."""
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
        """The assembly branch of the reference configuration, a `Continuation`, which follows closed loops from there
        to other configurations; None for a tree. Raises `LoopError` where loops cannot be closed."""
        if self._looped is None:
            return None
        from adaptctl.dynamics.loops.continuation import Continuation

        return Continuation(*self._looped)

    @property
    def neutral_configuration(self) -> Array:
        """Home configuration: positions (r,) of the r primary (independent) joints, rad (m if prismatic), in the closed
        reference configuration; zeros for a tree. Raises `LoopError` where loops cannot be closed."""
        loops = self.continuation
        return np.zeros(self.dof) if loops is None else loops.reference[loops.primary]

    def configuration(self, p: ArrayLike, start: ArrayLike | None = None) -> Array:
        """Positions (..., n), rad (m if prismatic), of the tree's n joints, loops closed, at those of the r primary
        (independent) ones, `p` (..., r) (Sheu and Walker 1991, equation 1); p itself for a tree. Followed along
        straight lines in p from the closed `start` (..., n), None: the reference configuration. Raises `InputError` on
        a wrong shape, `NonFiniteError` on NaN or infinity, `SingularityError` near singularities of loops."""
        loops = self.continuation
        if loops is not None and start is None and (known := loops.follow_alone(p)) is not None:
            return known
        p = checked(p, self.dof, f"{self.name}: p")
        begin = None if start is None else checked(start, len(self.links), f"{self.name}: start")
        return p if loops is None else loops.follow(p, begin)

    @property
    def name(self) -> str:
        """The mechanism's name, a text, from its description, by which error messages call it."""
        return self.description.name

    @property
    def dof(self) -> int:
        """Number r of primary joints, those whose positions p describe the motion: the degrees of freedom."""
        return len(self.description.primary)

    @property
    def links(self) -> tuple[Link, ...]:
        """The n links of the tree in depth-first order, parents before children, each with the joint that moves it."""
        return self.description.links

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P parameters: ten of each body (link not massless), mass m, first moment mc_x, mc_y, mc_z and
        inertia I_xx, I_xy, I_yy, I_xz, I_yz, I_zz, as in `link3.I_xx`, then the drives', as in `joint2.viscous`, kind
        by kind: rotor_inertia, viscous, coulomb, square_root, stribeck, offset."""
        return self.description.parameter_names

    @cached_property
    def inertial_parameters(self) -> Array:
        """The P inertial and friction parameters D (P,), read-only, SI, ordered as `parameter_names`: of each link not
        massless m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz in its frame, then drives' terms."""
        return self.description.inertial_parameters

    @property
    def is_plain_tree(self) -> bool:
        """True for a tree with no loops, couplings of joints or constraints, whose bodies have ten free parameters."""
        return self.description.loops is None

    @property
    def unconstrained(self) -> Mechanism:
        """The same mechanism with no linear constraints on its parameters: this object where there are none."""
        return self

    @property
    def free_directions(self) -> Array:
        """Derivatives (P, Z) of all P parameters with respect to the Z that linear constraints leave free, in the unit
        of the former per unit of the latter; the identity (P, P) without constraints."""
        return np.eye(len(self.parameter_names))

    @property
    def num_energy_parameters(self) -> int:
        """Number of parameters that enter the energy, the first of all P: ten a body, then rotors. Friction is last."""
        return self.description.num_energy_parameters

    @property
    def geometry_sha256(self) -> str:
        """SHA-256 hash (hexadecimal) of the data that decide which parameters are identifiable: gravity, joints,
        frames, link names, loops, drive terms, constraints, numbers rounded to 1e-12; not parameters' values."""
        return self.description.geometry_sha256

    @cached_property
    def effort_limits(self) -> Array:
        """Greatest torques (r,) of the r primary joints, N m (N if prismatic), infinite where not known; read-only."""
        return frozen(np.array([joint.limits.effort for joint in self.primary_joints]))

    @property
    def primary_joints(self) -> tuple[Joint, ...]:
        """The r primary (independent) joints, in the order of their positions p (r,); with loops, the others follow."""
        return tuple(self.links[i].joint for i in self.description.primary)

    def with_parameters(self, parameters: ArrayLike) -> Mechanism:
        """A copy of this mechanism with other values of its P inertial and friction `parameters` (P,), SI units, in the
        order of `parameter_names`. Raises `InputError` for another number of them, values not finite or above 1e20 in
        size, and rotor inertia, viscous or Coulomb friction below 0."""
        return Mechanism(self.description.with_parameters(parameters))

    def column_regressor(self, regressor: str, columns: Sequence[int]) -> OnArrays:
        """The equation on arrays of a `regressor`, "torque_regressor" or "slotine_li_regressor", for the k parameters
        of indices `columns`. Its `call` takes the arrays p, v, a or p, v, v_r, a_r of that method, (..., r) of r
        primary (independent) joints, rad, rad/s, rad/s^2 (m, m/s, m/s^2), and returns (..., r, k), N m (N if prismatic)
        per unit. Raises `InputError` for another name and for an index that is not from 0 to P - 1."""
        asked = required_columns(columns, len(self.parameter_names), self.name)
        return self._arrays.on_columns(regressor, tuple(asked))

    def with_drives(self, drives: Drive | Sequence[Drive]) -> Mechanism:
        """A copy of this mechanism, constraints on parameters included, with other rotors and friction: one drive for
        all n joints of the tree or one each, in the order of `links`. Each term of a drive is a parameter; `Drive()`
        has none. Raises `InputError` for another number of drives and for one that turns with unknown joints."""
        return Mechanism(self.description.with_drives(drives))

    def energy_regressor(self, p: ArrayLike, v: ArrayLike, out: Array | None = None) -> Array:
        """Energy regressor E (..., P), J per unit of each of P parameters, at positions p and velocities v (..., r) of
        r primary (independent) joints, rad, rad/s (m, m/s if prismatic): E @ D is kinetic plus potential energy, the
        latter 0 at the ground frame's origin, D (P,) the `inertial_parameters` (Sheu and Walker 1991, section 2.2).
        `out`, float64 (..., P), is filled and returned; None for a new one. Raises `InputError` on wrong shapes,
        `NonFiniteError` on NaN or infinity, `SingularityError` near singularities of loops."""
        if out is None:
            return self._arrays.energy_regressor.call(p, v)
        return self._arrays.energy_regressor.into(out, p, v)

    @finite_results
    def energy(self, p: ArrayLike, v: ArrayLike) -> Array:
        """Kinetic plus potential energy (...), J, the latter 0 at the ground frame's origin, at positions p, rad (m if
        prismatic), and velocities v, rad/s (m/s), both (..., r), of r primary joints. Raises `InputError` on a wrong
        shape, `NonFiniteError` on NaN or infinity, `SingularityError` near singularities of loops."""
        return self.energy_regressor(p, v) @ self.inertial_parameters

    def torque_regressor(
        self,
        p: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        columns: Sequence[int] | None = None,
        out: Array | None = None,
    ) -> Array:
        """The torque regressor Y (..., r, P), N m (N if prismatic) per unit of the P `inertial_parameters` D (P,): Y D
        is the torque, gravity and friction included, that gives r primary joints the accelerations a at positions p and
        velocities v, all (..., r), rad, rad/s, rad/s^2 (m, m/s, m/s^2). `columns` are indices of k parameters, then Y
        is (..., r, k); None for all. `out`, float64 like Y, is filled and returned; None: a new one. Raises
        `InputError` on a wrong shape or index, `NonFiniteError` on NaN, infinity, `SingularityError` near loop
        singularities."""
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
        """The Slotine-Li regressor Y_r (..., r, P), N m (N if prismatic) per unit of the P `inertial_parameters` D
        (P,): Y_r D = M a_r + C v_r + g + friction at v_r, M the mass matrix, C the Christoffel (Coriolis) one at v, g
        gravity. p, v, v_r, a_r are positions, velocities, Slotine and Li's reference velocities and accelerations (...,
        r) of r primary joints, rad, rad/s, rad/s^2 (m, m/s, m/s^2). `columns` are indices of k parameters, then Y_r is
        (..., r, k); None for all. `out`, float64 like Y_r, is filled and returned; None: a new one. Raises `InputError`
        on a wrong shape or index, `NonFiniteError` on NaN, infinity, `SingularityError` near loop singularities."""
        own = self._arrays.slotine_li_regressor
        equation = own if columns is None else self.column_regressor("slotine_li_regressor", columns)
        return equation.call(p, v, v_r, a_r) if out is None else equation.into(out, p, v, v_r, a_r)

    def inverse_dynamics(self, p: ArrayLike, v: ArrayLike, a: ArrayLike, out: Array | None = None) -> Array:
        """Torque (..., r), N m (N if prismatic), of the r primary (independent) joints that gives the accelerations a,
        rad/s^2 (m/s^2), at positions p, rad (m), and velocities v, rad/s (m/s), all (..., r), with gravity and
        friction. `out`, float64 (..., r), is filled and returned, None for a new one. Raises `InputError` on a wrong
        shape, `NonFiniteError` on NaN or infinity, `SingularityError` near singularities of loops."""
        if out is None:
            return self._arrays.inverse_dynamics.call(p, v, a, self.inertial_parameters)
        return self._arrays.inverse_dynamics.into(out, p, v, a, self.inertial_parameters)

    def constraint_bias_torque(self, p: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Torque (..., r), N m (N if prismatic), due to values that linear constraints on parameters fix, which
        regressors leave out: zero without any. p, v, a are positions, velocities, accelerations (..., r) of r primary
        (independent) joints, rad, rad/s, rad/s^2 (m, m/s, m/s^2). Raises `InputError` on a wrong shape,
        `NonFiniteError` on NaN or infinity, with constraints `SingularityError` near loop singularities."""
        given = {"p": p, "v": v, "a": a}
        samples = same_samples(**{what: checked(x, self.dof, f"{self.name}: {what}") for what, x in given.items()})
        return np.zeros((*samples, self.dof))

    def forward_dynamics(self, p: ArrayLike, v: ArrayLike, torque: ArrayLike, out: Array | None = None) -> Array:
        """Accelerations (..., r), rad/s^2 (m/s^2 if prismatic), of r primary joints under `torque` (..., r), N m (N),
        gravity and friction, at positions p, rad (m), and velocities v, rad/s (m/s), both (..., r). `out`, float64
        (..., r), is filled and returned; None: a new one. Raises `InputError` on a wrong shape and for a tree's end
        links without mass or rotor, `NonFiniteError` on NaN, infinity, `SingularityError` near loop singularities."""
        if out is None:
            return self._arrays.forward_dynamics.call(p, v, torque, self.inertial_parameters)
        return self._arrays.forward_dynamics.into(out, p, v, torque, self.inertial_parameters)

    def validate_mass(self) -> None:
        """Raise `InputError`, naming them, for a tree's links that have neither inertia nor rotor, nor a descendant
        with either: torques do not determine their joints' accelerations. Mechanisms with loops pass."""
        if self.description.massless_joints:
            names = ", ".join(self.description.massless_joints)
            raise InputError(f"{self.name}: links move without mass and carry none, give them some: {names}")

    def mass_matrix(self, p: ArrayLike, out: Array | None = None) -> Array:
        """Mass matrix (..., r, r), symmetric, with rotors, kg m^2 (kg if prismatic, kg m mixed), at positions p (...,
        r), rad (m), of r primary joints. `out`, float64 (..., r, r), is filled and returned; None: a new one. Raises
        `InputError` on wrong shapes, `NonFiniteError` on NaN, infinity, `SingularityError` near loop singularities."""
        if out is None:
            return self._arrays.mass_matrix.call(p, self.inertial_parameters)
        return self._arrays.mass_matrix.into(out, p, self.inertial_parameters)

    @needed("Mechanism.to_pinocchio")
    def to_pinocchio(self) -> pinocchio.Model:
        """A Pinocchio model of this mechanism's spanning tree, in depth-first order, without its loop closures. Raises
        `InputError` for a first moment without mass and for drives that turn with several joints, `MissingExtraError`
        without Pinocchio. Warns (`SimplificationWarning`) of friction other than viscous and Coulomb's, left out."""
        from adaptctl.description.readers.pinocchio_model import to_pinocchio

        return to_pinocchio(self.description)

    @needed("Mechanism.to_pinocchio_constraints")
    def to_pinocchio_constraints(self) -> list[pinocchio.RigidConstraintModel]:
        """Pinocchio's constraint models of the loop closures, for the model of `to_pinocchio()`; an empty list for a
        tree. Raises `InputError` where joints follow others (couplings), for a first moment without mass and for drives
        that turn with several joints, `MissingExtraError` without Pinocchio."""
        from adaptctl.description.readers.pinocchio_model import to_pinocchio_constraints

        return to_pinocchio_constraints(self.description, self.to_pinocchio())

    @classmethod
    @needed("Mechanism.from_pinocchio")
    def from_pinocchio(cls, model: pinocchio.Model) -> Mechanism:
        """A mechanism from a Pinocchio model. Its joints are put in depth-first order: look them up by name. Raises
        `InputError` for joints that are neither revolute nor prismatic, no joints and gravity with an angular part,
        `MissingExtraError` without Pinocchio. Warns (`SimplificationWarning`) of limits of zero, taken as no limits."""
        from adaptctl.description.readers.pinocchio_model import from_pinocchio

        return cls(from_pinocchio(model))

    def write_into(self, original: str | Path, path: str | Path, root: str | None = None) -> None:
        """Write at `path` the URDF or MJCF file `original` with the inertias of this mechanism's links; the rest,
        drives included, stays byte for byte. `root` is the mechanism's first body in an MJCF scene; None: the one root
        body that moves. Raises `FileError` for a file of another mechanism or not readable or writable, inertias
        without mass and, in MJCF, inertias of no rigid body, `InputError` for another suffix or a `root` of a URDF."""
        from adaptctl.description.writers.robot_file import write_robot

        write_robot(path, original, self.description, root)

    def in_pinocchio(self, model: pinocchio.Model) -> pinocchio.Model:
        """A copy of `model`, with the same joints by name, with this mechanism's inertias, rotors (armature), viscous
        and Coulomb friction; all else stays. Pinocchio's inverse dynamics leaves friction out. Raises `InputError` for
        another number of joints, a first moment without mass and drives that turn with several joints, `NotFoundError`
        for an unknown joint. Warns (`SimplificationWarning`) of friction not viscous or Coulomb's, left out."""
        from adaptctl.description.readers.pinocchio_model import with_inertias

        return with_inertias(model, self.description)

    @needed("Mechanism.to_mujoco")
    def to_mujoco(self) -> mujoco.MjModel:
        """A MuJoCo model of this tree, with a motor (N m, N) at each joint. Raises `InputError` for loops, drives that
        turn with several joints, inertias that no rigid body has, and friction other than viscous and Coulomb's,
        `MissingExtraError` without MuJoCo."""
        from adaptctl.description.writers.mujoco_model import to_mujoco

        return to_mujoco(self.description)

    @classmethod
    @needed("Mechanism.from_mujoco")
    def from_mujoco(cls, model: mujoco.MjModel, body: str | None = None) -> Mechanism:
        """A mechanism from a MuJoCo `model`, which may be of a whole scene: the body named `body` with its descendants;
        None for the one root body on which joints turn or slide. Raises `InputError` for no joint, ball and free
        joints, nonlinear damping, nonlinear equalities, over 256 links, a `body` that stands on a moving one
        and, for None, several moving roots, `NotFoundError` for an unknown name, `MissingExtraError` without MuJoCo.
        Warns (`SimplificationWarning`) of springs and gravity compensation, left out, and of non-torque actuators."""
        from adaptctl.description.readers.mujoco_model import from_mujoco

        return cls(from_mujoco(model, body))


def load(
    source: str | Path | pinocchio.Model | mujoco.MjModel,
    *,
    floating_base: bool = False,
    snap: bool = False,
    mesh_folders: Sequence[str | Path] = (),
    root: str | None = None,
) -> Mechanism:
    """A mechanism from a `source`, a built-in's name (`puma560`, ...), a file (.toml, .urdf, .xml, .mjcf), or a
    Pinocchio or MuJoCo model. With `floating_base`, a URDF file's root link floats, not fixed to the ground; its meshes
    are shown from its package and `mesh_folders`. With `snap`, angles between successive joint axes within 1e-3 rad of
    a multiple of 90 degrees are made exact. `root` names the mechanism's first body in an MJCF scene or a MuJoCo model;
    None for the one root body that moves. Raises `NotFoundError` for an unknown name or root of a model, `FileError`
    for a file that cannot be used, `InputError` for a model that cannot, other objects, a floating base or mesh folders
    without URDF, a `root` without MJCF or MuJoCo, `LoopError` where a file's loops cannot be closed. Warns
    (`PhysicalConsistencyWarning`) of inertias that no rigid body has, (`SimplificationWarning`) of what is left out."""
    from adaptctl.description.readers.registry import read, read_model

    options: dict[str, Any] = {"floating_base": floating_base, "snap": snap, "mesh_folders": mesh_folders, "root": root}
    if not isinstance(source, str | Path):
        return Mechanism(read_model(source, **options))
    mechanism = Mechanism(read(source, **options))
    try:
        _ = mechanism.continuation  # Closes the loops, so that a wrong file is named here and not later.
    except LoopError as error:
        raise LoopError(f"{source}: {error}") from error
    return mechanism
