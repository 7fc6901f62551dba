"""Model reduction: the combinations of parameters that carry the energy of given motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, frozen_array, real_number, whole_number
from adaptctl.caching import sent_as_made
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, require_kind
from adaptctl.identifiability.essential_space import EssentialSpace


@sent_as_made
@dataclass(frozen=True, eq=False)
class Reduction:
    """A reduction of P inertial parameters to essential components: the parameters, less their part that changes no
    energy, as a sum of k components, of which only those with the largest weights are kept (Sheu and Walker 1991,
    section 3.2).

    It holds for `states`, the motions behind the essential space's singular values, in words, and for the parameters D
    (P,) from which it was made: others change the weights. `components` (k, P), in descending order of size of their
    weight, are in the parameters' SI units, k the space's rank, and the first `kept` of them sum to the reduced
    parameters. With H c the energy differences (J) that parameters c make between successive states, and |.| the root
    of the summed squares, the size of each of the `weights` (k,), J, is |H c| of its component c; `order` (k,) has the
    zero-based column indices of the essential space's `basis` V1 from which the components come; `percent_errors` (k +
    1,) are the errors 100 |H (D' - D)| / |H D| in percent (equation 23) of the sums D' of the first 0, 1, ... k
    components. Made by `reduce`, with read-only arrays; nothing is checked at construction.
    """

    states: str
    components: Array
    weights: Array
    order: tuple[int, ...]
    percent_errors: Array
    kept: int

    @property
    def percent_error(self) -> float:
        """The energy error, in percent, of the reduced parameters D', the sum of the kept components: 100 |H (D' - D)|
        / |H D| for the parameters D. H D are the differences (J) of kinetic plus potential energy between successive
        states, and |.| is the root of the summed squares."""
        return float(self.percent_errors[self.kept])

    def parameters(self, components: int | None = None) -> Array:
        """Reduced values (P,) of the P inertial parameters in SI units, without friction: the sum of the first
        `components` of the k essential components, those with the largest weights; of all that are kept where None.

        The components are the parts (P,) of the parameters along the k directions that change energies. Raises
        `InputError` unless `components` is a whole number from 0 to k.
        """
        count = self.kept if components is None else _checked_count(components, len(self.weights))
        return self.components[:count].sum(axis=0)


def reduce(
    space: EssentialSpace,
    parameters: Mechanism | ArrayLike,
    *,
    energy_error: float | None = None,
    components: int | None = None,
) -> Reduction:
    """The reduction of inertial parameters to the fewest essential components (parts along the singular vectors in the
    space's `basis`) with an energy error of at most `energy_error` percent, or to a number of `components`, from 0 to
    the space's rank.

    `parameters` are inertial parameters (P,) in SI units, without friction, or a mechanism that has them. The error, in
    percent, is 100 |H (D' - D)| / |H D| for the parameters D and the reduced ones D', where H D are the differences (J)
    of kinetic plus potential energy between successive ones of the space's `states`, and |.| is the root of the summed
    squares (equation 22 of Sheu and Walker 1991). Raises `InputError` unless one of `energy_error` and `components` is
    given, the other None; for an `energy_error` below 0, not finite or no number, and `components` out of range or no
    whole number; and for parameters of a wrong shape, not finite, or without energy differences between the states.
    """
    require_kind(space, EssentialSpace, "reduce", "as essential_space(mechanism) gives one")
    if (energy_error is None) == (components is None):
        raise InputError("give one of energy_error, in percent, and components, a number")
    if isinstance(parameters, Mechanism):
        parameters = np.asarray(parameters.inertial_parameters)[: parameters.energetic]
    D = frozen_array(parameters, (len(space.parameter_names),), "parameters")
    alpha = space.basis.T @ D
    beta = space.singular_values[: space.rank] * alpha
    order = np.argsort(-np.abs(beta), kind="stable")
    errors = _percent_errors(beta[order])
    count = _enough(errors, energy_error) if energy_error is not None else components
    return Reduction(
        states=space.states,
        components=frozen(alpha[order, None] * space.basis[:, order].T),
        weights=frozen(beta[order]),
        order=tuple(order.tolist()),
        percent_errors=frozen(errors),
        kept=_checked_count(count, space.rank),
    )


def _percent_errors(weights: Array) -> Array:
    """Equation 23 for every s, summed from the smallest so that the last ones keep their digits."""
    tails = np.append(np.cumsum(weights[::-1] ** 2)[::-1], 0.0)
    if tails[0] == 0.0:
        raise InputError("these parameters have no energy in any of the states, so there is nothing to reduce")
    return np.asarray(100.0 * np.sqrt(tails / tails[0]))


def _enough(errors: Array, energy_error: float) -> int:
    if not 0.0 <= real_number(energy_error, "energy_error") < np.inf:
        raise InputError(f"energy_error: expected a percentage of at least 0, got {energy_error}")
    return int(np.argmax(errors <= energy_error))


def _checked_count(count: int | None, most: int) -> int:
    if isinstance(count, int | np.integer) and not 0 <= count <= most:
        raise InputError(f"components: expected 0..{most}, got {count}")
    if isinstance(count, bool):
        raise InputError(f"components: expected a whole number from 0 to {most}, got {count}")
    return whole_number(count, "components", 0, most)
