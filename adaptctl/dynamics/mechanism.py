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
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.errors import InputError, LoopError
from adaptctl.markup import table, titled
from adaptctl.packages import needed

if TYPE_CHECKING:
    import mujoco
    import pinocchio

    from adaptctl.dynamics.array_equation import ArrayEquation
    from adaptctl.dynamics.loop_equations import LoopEquations
    from adaptctl.dynamics.loops.continuation import Continuation


class Mechanism:
    """A mechanism made from a `Description`, with its energies, torques, regressors and accelerations on arrays.

    Trailing axes are the mathematics, leading axes are samples: p, v, a, torque are (..., r), regressors (..., P) and
    (..., r, P). Angles in rad, lengths in m, torques in N m (N for a prismatic joint). The equations run in Python
    until it pays to compile them (`ArrayEquation` has the rule), then in native code. `out` takes a result in place of
    a fresh array. Every method on arrays raises `InputError` on a wrong shape and `NonFiniteError` on NaN or infinity;
    with loops, `LoopError` where they do not fit together and `SingularityError` near a configuration where they lock.
    """

    def __init__(self, description: Description) -> None:
        self.description = description

    def __repr__(self) -> str:
        return f"<Mechanism {self.name!r}: {len(self.links)} links, {self.dof} degrees of freedom>"

    def _repr_html_(self) -> str:
        """Notebook's view of the mechanism: a table with a row a link."""
        heads = ("link", "parent", "joint", "kind", "limits", "effort", "mass [kg]")
        links = self.links
        rows = [
            (
                link.name,
                links[link.parent].name if link.parent >= 0 else "ground",
                link.joint.name,
                link.joint.kind.value,
                f"{link.joint.limits.lower:.4g} to {link.joint.limits.upper:.4g}",
                f"{link.joint.limits.effort:.4g}",
                f"{link.inertia[0]:.4g}",
            )
            for link in links
        ]
        text = f"{len(links)} links, {self.dof} degrees of freedom, {len(self.parameter_names)} parameters"
        return titled(self.name, text) + table(heads, rows)

    @cached_property
    def _arrays(self) -> ArrayEquations:
        return ArrayEquations(self)

    @cached_property
    def equations(self) -> Equations:
        """The equations of motion over scalars of any kind, to trace or to differentiate: see `Equations`. Raises
        `LoopError` where loops do not fit together."""
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
        """The branch of closed configurations through the reference; None for a tree. Raises `LoopError` where loops do
        not fit together."""
        if self._looped is None:
            return None
        from adaptctl.dynamics.loops.continuation import Continuation

        return Continuation(*self._looped)

    @property
    def home(self) -> Array:
        """Positions (r,), rad (m for a prismatic joint), at which the loops are known to close, those of the reference;
        zeros for a tree. Raises `LoopError` where loops do not fit together."""
        if self.continuation is None:
            return np.zeros(self.dof)
        return self.continuation.reference[self.continuation.primary]

    def configuration(self, p: ArrayLike, start: ArrayLike | None = None) -> Array:
        """Joint positions q = U(p) (..., n), rad (m), of the tree at primary positions p (..., r), with all loops
        closed (Sheu and Walker 1991, equation 1); for a tree p itself. They are followed along straight lines from the
        closed `start` (..., n), None being the reference. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN
        or infinity, `SingularityError` near locked loops."""
        (p,), _ = self._joints(p=p)
        if self.continuation is None:
            return p
        return self.continuation.follow(p, None if start is None else checked(start, len(self.links), "start"))

    @property
    def name(self) -> str:
        """The mechanism's name."""
        return self.description.name

    @property
    def dof(self) -> int:
        """Number of primary joints r, those whose coordinates are p."""
        return len(self.description.primary)

    @property
    def links(self) -> tuple[Link, ...]:
        """The links in depth-first order."""
        return self.description.links

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P parameters: ten a body, `link3.I_xx`, then the drives', `joint2.viscous`."""
        return self.description.parameter_names

    @cached_property
    def inertial_parameters(self) -> Array:
        """The inertial parameters D (P,) in SI units (kg, kg m, kg m^2, then the drives'), read-only."""
        return self.description.inertial_parameters

    @property
    def is_plain_tree(self) -> bool:
        """True for a tree whose bodies have ten free parameters each: no loops, no constraints on parameters."""
        return self.description.loops is None

    @property
    def unconstrained(self) -> Mechanism:
        """The same mechanism without constraints on its parameters: itself where there are none."""
        return self

    @property
    def free_directions(self) -> Array:
        """Derivatives (P, Z) of the P parameters of `unconstrained` by each of this mechanism's Z: the identity without
        constraints."""
        return np.eye(len(self.parameter_names))

    @property
    def energetic(self) -> int:
        """Number of parameters that enter the energy: all but friction, which comes last."""
        return self.description.energetic

    @property
    def geometry_sha256(self) -> str:
        """SHA-256 hash (hexadecimal) of gravity and geometry, which decide which parameters matter."""
        return self.description.geometry_sha256

    @cached_property
    def effort_limits(self) -> Array:
        """Greatest torque of every primary joint (r,), N m (N if prismatic), infinite where not known; read-only."""
        return frozen(np.array([joint.limits.effort for joint in self.primary_joints]))

    @property
    def primary_joints(self) -> tuple[Joint, ...]:
        """The joints whose coordinates are p, in its order."""
        return tuple(self.links[i].joint for i in self.description.primary)

    def with_parameters(self, parameters: ArrayLike) -> Mechanism:
        """The same mechanism with other inertial parameters (P,), SI units. Raises `InputError` for another number of
        them, and for values not finite, above 1e20, or negative where a term of a drive must not be."""
        return Mechanism(self.description.with_parameters(parameters))

    def on_columns(self, regressor: str, columns: Sequence[int]) -> ArrayEquation:
        """The equation on arrays of a regressor, "torque_regressor" or "slotine_li_regressor", with the k `columns`
        only, indices of parameters: its `call` takes the arguments of the method of that name and returns (..., r, k).
        Raises `InputError` for an index outside 0..P-1."""
        return self._arrays.on_columns(regressor, tuple(self._columns(columns)))

    def with_drives(self, drives: Drive | Sequence[Drive]) -> Mechanism:
        """The same mechanism with other rotors and friction in its tree's joints, one drive for all or one each (n).
        Each term of a drive is a parameter like the others; `Drive()` has none. Raises `InputError` for another number
        of drives."""
        return Mechanism(self.description.with_drives(drives))

    def energy_regressor(self, p: ArrayLike, v: ArrayLike, out: Array | None = None) -> Array:
        """The energy regressor E (..., P), J per unit of each parameter, at p (..., r), rad (m), and v (..., r), rad/s
        (m/s): kinetic plus potential energy is E @ D (Sheu and Walker 1991, section 2.2). `out` is filled and returned,
        None for a fresh array. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity,
        `SingularityError` near locked loops."""
        if out is None:
            return self._arrays.energy_regressor.call(p, v)
        return self._arrays.energy_regressor.into(out, p, v)

    @finite_results
    def energy(self, p: ArrayLike, v: ArrayLike) -> Array:
        """Kinetic plus potential energy (...), in J, at positions p (..., r), rad (m), and velocities v (..., r), rad/s
        (m/s). Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity, `SingularityError` near locked
        loops."""
        return self.energy_regressor(p, v) @ self.inertial_parameters

    def torque_regressor(
        self,
        p: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        columns: Sequence[int] | None = None,
        out: Array | None = None,
    ) -> Array:
        """The torque regressor Y (..., r, P), N m (N) per unit of each parameter: the equations of motion are tau = Y
        D. p, v and a are (..., r) in rad, rad/s, rad/s^2 (m for prismatic joints). `columns` are the indices of the k
        parameters asked for, then Y is (..., r, k); None for all. `out` is filled and returned, None for a fresh array.
        Raises `InputError` on a wrong shape or index, `NonFiniteError` on NaN or infinity, `SingularityError` near
        locked loops."""
        own = self._arrays.torque_regressor
        equation = own if columns is None else self.on_columns("torque_regressor", columns)
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
        """The Slotine-Li regressor Y_r (..., r, P), N m (N) per unit of each parameter: Y_r D = M(p) a_r + C(p, v) v_r
        + g(p) + friction at v_r, C the Christoffel one (Slotine and Li 1987). p, v, v_r, a_r are (..., r) in rad,
        rad/s, rad/s, rad/s^2 (m if prismatic). `columns` are the indices of the k parameters asked for, then Y_r is
        (..., r, k); None for all. `out` is filled and returned, None for a fresh array. Raises `InputError` on a wrong
        shape or index, `NonFiniteError` on NaN or infinity, `SingularityError` near locked loops."""
        own = self._arrays.slotine_li_regressor
        equation = own if columns is None else self.on_columns("slotine_li_regressor", columns)
        return equation.call(p, v, v_r, a_r) if out is None else equation.into(out, p, v, v_r, a_r)

    def inverse_dynamics(self, p: ArrayLike, v: ArrayLike, a: ArrayLike, out: Array | None = None) -> Array:
        """Torque (..., r), N m (N for a prismatic joint), that gives the accelerations a (..., r), rad/s^2 (m/s^2), at
        positions p (..., r), rad (m), and velocities v (..., r), rad/s (m/s). `out` is filled and returned, None for a
        fresh array. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity, `SingularityError` near
        locked loops."""
        if out is None:
            return self._arrays.inverse_dynamics.call(p, v, a, self.inertial_parameters)
        return self._arrays.inverse_dynamics.into(out, p, v, a, self.inertial_parameters)

    def known_torque(self, p: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """The part of the torque (..., r), N m (N), due to known parameters, which regressors times parameters leave
        out: zero without constraints on parameters. p, v, a are (..., r) in rad, rad/s, rad/s^2 (m if prismatic).
        Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity."""
        _, samples = self._joints(p=p, v=v, a=a)
        return np.zeros((*samples, self.dof))

    def forward_dynamics(self, p: ArrayLike, v: ArrayLike, torque: ArrayLike, out: Array | None = None) -> Array:
        """Accelerations (..., r), rad/s^2 (m/s^2), under a torque (..., r), N m (N), at p (..., r), rad (m), and v
        (..., r), rad/s (m/s). `out` is filled and returned, None for a fresh array. Raises `InputError` on a wrong
        shape or links without mass to be accelerated, `NonFiniteError` on NaN or infinity, `SingularityError` near
        locked loops."""
        if out is None:
            return self._arrays.forward_dynamics.call(p, v, torque, self.inertial_parameters)
        return self._arrays.forward_dynamics.into(out, p, v, torque, self.inertial_parameters)

    def require_mass(self) -> None:
        """Raise `InputError` for a tree with links that have no mass and carry none, with their names: torques do not
        determine its accelerations."""
        if self.description.weightless:
            names = ", ".join(self.description.weightless)
            raise InputError(f"{self.name}: links move without mass and carry none, give them some: {names}")

    def mass_matrix(self, p: ArrayLike, out: Array | None = None) -> Array:
        """The mass matrix M(p) (..., r, r), kg m^2 (kg between prismatic joints), at p (..., r), rad (m). `out` is
        filled and returned, None for a fresh array. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or
        infinity, `SingularityError` near locked loops."""
        if out is None:
            return self._arrays.mass_matrix.call(p, self.inertial_parameters)
        return self._arrays.mass_matrix.into(out, p, self.inertial_parameters)

    @needed("Mechanism.to_pinocchio")
    def to_pinocchio(self) -> pinocchio.Model:
        """The same mechanism as a Pinocchio model, built depth first; with loops, its tree's, loops left open. Raises
        `InputError` for a first moment without mass and for drives that turn with several joints, `MissingExtraError`
        without Pinocchio."""
        from adaptctl.description.readers.pinocchio_model import to_pinocchio

        return to_pinocchio(self.description)

    @needed("Mechanism.to_pinocchio_constraints")
    def to_pinocchio_constraints(self) -> list[pinocchio.RigidConstraintModel]:
        """The loops as Pinocchio's constraint models, for `to_pinocchio()`'s model; an empty list for a tree. Raises
        `InputError` as `to_pinocchio` does and where joints follow others, for which Pinocchio has no such model,
        `MissingExtraError` without Pinocchio."""
        from adaptctl.description.readers.pinocchio_constraints import to_pinocchio_constraints

        return to_pinocchio_constraints(self.description, self.to_pinocchio())

    @classmethod
    @needed("Mechanism.from_pinocchio")
    def from_pinocchio(cls, model: pinocchio.Model) -> Mechanism:
        """A mechanism from a Pinocchio model, whatever order it was built in. Raises `InputError` for joints that are
        not revolute or prismatic with one coordinate, `MissingExtraError` without Pinocchio."""
        from adaptctl.description.readers.pinocchio_model import from_pinocchio

        return cls(from_pinocchio(model))

    def write_into(self, original: str | Path, path: str | Path, root: str | None = None) -> None:
        """Write at `path` the URDF or MJCF file `original` with this mechanism's links' inertias; the rest stays byte
        for byte, and joints' drives are not written. `root` is the body of an MJCF scene that it begins with, None
        where one moves. Raises `FileError` for another mechanism's file, inertias without mass and, in MJCF, of no
        rigid body (see `identifiability.nearest_consistent`), `InputError` for another suffix."""
        from adaptctl.description.writers.robot_file import write_robot

        write_robot(path, original, self.description, root)

    def in_pinocchio(self, model: pinocchio.Model) -> pinocchio.Model:
        """A copy of a Pinocchio model of this mechanism with this mechanism's inertias and drives; its frames, limits
        and all else are as they were. Pinocchio's inverse dynamics has rotors, as armature, and leaves friction out.
        Raises `InputError` for another number of joints or a first moment without mass, `NotFoundError` for a joint
        that the model does not have."""
        from adaptctl.description.readers.pinocchio_model import with_inertias

        return with_inertias(model, self.description)

    @needed("Mechanism.to_mujoco")
    def to_mujoco(self) -> mujoco.MjModel:
        """The same tree as a MuJoCo model, a body a link and a motor a joint. Raises `InputError` for what MuJoCo's
        bodies and joints cannot be: loops, inertias of no rigid body, friction beyond viscous and Coulomb's."""
        from adaptctl.description.writers.mujoco_model import to_mujoco

        return to_mujoco(self.description)

    @classmethod
    @needed("Mechanism.from_mujoco")
    def from_mujoco(cls, model: mujoco.MjModel, body: str | None = None) -> Mechanism:
        """A mechanism from a MuJoCo model, which may hold a whole scene: the body named `body` and all that hangs on
        it; None for the one root body on which joints turn or slide. Raises `InputError` for ball and free joints,
        equalities and where not just one root moves, `NotFoundError` for an unknown name. Warns
        (`SimplificationWarning`) of what is left out."""
        from adaptctl.description.readers.mujoco_model import from_mujoco

        return cls(from_mujoco(model, body))

    def _joints(self, **given: ArrayLike) -> tuple[list[Array], tuple[int, ...]]:
        """Checked arrays (..., r) and the sample axes they share."""
        arrays = {what: checked(values, self.dof, f"{self.name}: {what}") for what, values in given.items()}
        return list(arrays.values()), same_samples(**arrays)

    def _columns(self, columns: Sequence[int] | None) -> Sequence[int]:
        known = len(self.parameter_names)
        if columns is None:
            return range(known)
        wrong = [c for c in columns if not 0 <= c < known]
        if wrong:
            raise InputError(f"{self.name}: columns must be in 0..{known - 1}, got {wrong[0]}")
        return columns


def load(
    source: str | Path | pinocchio.Model | mujoco.MjModel,
    *,
    floating_base: bool = False,
    snap: bool = False,
    mesh_folders: Sequence[str | Path] = (),
    root: str | None = None,
) -> Mechanism:
    """A mechanism by a built-in's name (`puma560`, ...), from a file (.toml, .urdf, .xml), or from a Pinocchio or
    MuJoCo model.

    With `floating_base`, a URDF file's root link floats instead of being fixed to the ground; its meshes are shown from
    its package and from `mesh_folders`. With `snap`, angles between joint axes that are within 1e-3 rad of right ones
    are made exact. `root` names the body of an MJCF scene, or of a MuJoCo model, that the mechanism begins with; None
    for the one that moves. Raises `FileError` or `NotFoundError` with what was wrong and what would be right,
    `InputError` for a floating base of another file or a root of what has none, `LoopError` where loops do not fit
    together. Warns (`PhysicalConsistencyWarning`) of links that no rigid body can be.
    """
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
