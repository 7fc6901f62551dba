"""The equations of motion of a plant on its fundamental parameters, with links' frames at their joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptctl.description.transforms import joint_frame_parameters, with_joint_frames
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.equations import Equations
from adaptctl.errors import AdaptctlError
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.scalars import Column, Scalar

LONGEST = 12
"""Links of a mechanism whose basis is looked for, which takes longer than is saved for more."""


class FundamentalMotion(NamedTuple):
    """A mechanism's equations of motion in fewer operations: in its fundamental (base) parameters, and with each link's
    frame at its joint. Regrouping the P inertial parameters onto the fundamental ones leaves many of the m parameters
    of these equations zero.

    `equations` are the equations, of m parameters. `sums` has for each of the m a tuple of pairs (index, weight): the
    parameter is the sum of the mechanism's own parameters (P,), SI units, at these zero-based indices, times their
    weights; the tuple is empty where it is zero. Nothing is checked.
    """

    equations: Equations
    sums: tuple[tuple[tuple[int, float], ...], ...]

    def parameters(self, true: Column) -> Column:
        """The m parameters, a Column (vector) (m,), SI units, of a mechanism's equations of motion on its fundamental
        (base) parameters: weighted sums of its own P inertial and friction parameters `true` (P,), zero where
        regrouping leaves none. Scalars are of any kind (floats, arrays, or symbols to be compiled). Raises `IndexError`
        where `true` is too short."""

        def total(terms: tuple[tuple[int, float], ...]) -> Scalar:
            (i, weight), *rest = terms
            return sum((w * true[j] for j, w in rest), weight * true[i])

        return Column(total(terms) if terms else 0.0 for terms in self.sums)


def fundamental_motion(mechanism: Mechanism) -> FundamentalMotion | None:
    """The equations of motion of a `mechanism` on its fundamental (base) parameters, a `FundamentalMotion`, or None.
    These parameters are the combinations of inertial parameters that the motion depends on, and take fewer operations
    than all.

    None is returned for a mechanism of more than LONGEST (12) links, for a subclass of `Mechanism`, as one with
    constraints on its parameters is, and where no such basis can be certified. Nothing is raised.
    """
    if type(mechanism) is not Mechanism or len(mechanism.links) > LONGEST:
        return None
    turned = Mechanism(with_joint_frames(mechanism.description))
    try:
        model = ReducedModel(turned, fundamental_basis(essential_space(turned, near="as_is")))
    except AdaptctlError:
        return None
    matrix = np.zeros((len(turned.parameter_names), len(mechanism.parameter_names)))
    matrix[list(model.columns)] = model.regrouping @ joint_frame_parameters(mechanism.description)
    return FundamentalMotion(turned.equations, tuple(_terms(row) for row in matrix))


def _terms(row: np.ndarray) -> tuple[tuple[int, float], ...]:
    places = np.flatnonzero(np.abs(row) > 1e-14 * np.abs(row).max())
    return tuple((int(i), float(row[i])) for i in places)
