"""The equations of motion of a plant on its fundamental parameters, with links' frames at their joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptctl.description.transforms.joint_frames import joint_frame_parameters, with_joint_frames
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.equations import Equations
from adaptctl.errors import AdaptctlError
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.scalars import Column, Scalar

LONGEST = 12
"""Links of a mechanism whose basis is looked for, which takes longer than is saved for more."""


class FundamentalMotion(NamedTuple):
    """The equations of the same motion in fewer operations: on `equations` of links with frames at their joints, of
    whose parameters all but some are zero; `sums` has, for each of these P', the terms of the true parameters that it
    is made of, their places and weights."""

    equations: Equations
    sums: tuple[tuple[tuple[int, float], ...], ...]

    def parameters(self, true: Column) -> Column:
        """The parameters (P',) of the equations, regrouped from the true ones (P,)."""

        def total(terms: tuple[tuple[int, float], ...]) -> Scalar:
            (i, weight), *rest = terms
            return sum((w * true[j] for j, w in rest), weight * true[i])

        return Column(total(terms) if terms else 0.0 for terms in self.sums)


def fundamental_motion(mechanism: Mechanism) -> FundamentalMotion | None:
    """The motion of a mechanism on its fundamental parameters; None for long ones, for constraints on parameters and
    where there is no certain basis."""
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
