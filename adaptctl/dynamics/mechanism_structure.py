"""Joints, parameters and closed loops of a mechanism."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen
from adaptctl.caching import cached_property
from adaptctl.description import Description, Joint, Link
from adaptctl.dynamics.array_equations import ArrayEquations
from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.errors import InputError, validate_kind
from adaptctl.markup import table, titled

if TYPE_CHECKING:
    from adaptctl.dynamics.loop_equations import LoopEquations
    from adaptctl.dynamics.loops.continuation import Continuation


class MechanismStructure:
    """Joints, parameters and closed loops of a `Mechanism`."""

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
