"""Model reduction: the fewest essential components within an energy error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, finite_number, frozen, frozen_array, whole_number
from adaptctl.caching import sent_as_made
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind
from adaptctl.identifiability.essential_space import EssentialSpace, energy_triangle
from adaptctl.identifiability.sampling import States

# States on which errors are judged: their sampling error is a few percent of the error.
JUDGED_STATES = 20_000


@sent_as_made
@dataclass(frozen=True, eq=False)
class Reduction:
    """
    Inertial parameters as a sum of essential components, of which the most important are kept.

    A component is the parameters' part along one singular vector of the energy differences. `reduce` makes the
    reduction. Arrays are read-only; nothing is checked at construction.

    Parameters
    ----------
    states : str
        Origin, in words, of the states on which the errors are judged.
    components : numpy.ndarray
        Components (k, P) in SI units, in descending order of the size of their weights.
    weights : numpy.ndarray
        Weights (k,) in J. The size of a weight is the root of the sum of squares of the component's energy differences,
        at the states of the space.
    order : tuple of int
        Column (k,) of the space's `basis` of each component.
    percent_errors : numpy.ndarray
        Energy errors (k + 1,) in percent if only the first 0, 1, ... k components are kept, on `states`.
    num_components : int
        Number of components that are kept.

    Notes
    -----
    The error of reduced parameters :math:`D'` is :math:`100 |H (D' - D)| / |H D|`, with the energy differences
    :math:`H D` between successive states [1]_.

    References
    ----------
    .. [1] Sheu and Walker, 1991. Identifying the independent inertial parameter space of robot manipulators.
       International Journal of Robotics Research, section 3.2, equation 23.

    Examples
    --------
    >>> reduction = adaptctl.reduce(space, arm, components=3)
    >>> reduction.parameters().shape, reduction.percent_error < 100.0
    ((20,), True)
    """

    states: str
    components: Array
    weights: Array
    order: tuple[int, ...]
    percent_errors: Array
    num_components: int

    def __repr__(self) -> str:
        kept = f"{self.num_components} of {len(self.weights)} components"
        return f"<Reduction to {kept}: energy error {self.percent_error:.3g} %>"

    @property
    def percent_error(self) -> float:
        """Energy error of the kept components' sum in percent."""
        return float(self.percent_errors[self.num_components])

    def parameters(self, components: int | None = None) -> Array:
        """
        Return the reduced inertial parameters, the sum of the most important components.

        Parameters
        ----------
        components : int, optional
            Number of components, from 0 to k. Default: those that are kept.

        Returns
        -------
        numpy.ndarray
            Reduced inertial parameters (P,) in SI units, without friction.

        Raises
        ------
        InputError
            If the number is out of range.

        Examples
        --------
        >>> reduction = adaptctl.reduce(space, arm, components=3)
        >>> bool(np.allclose(reduction.parameters(6), space.project(arm.inertial_parameters)))
        True
        """
        count = self.num_components if components is None else _checked_count(components, len(self.weights))
        return self.components[:count].sum(axis=0)


def reduce(
    space: EssentialSpace,
    parameters: Mechanism | ArrayLike,
    *,
    energy_error: float | None = None,
    components: int | None = None,
    states: States | None = None,
) -> Reduction:
    """
    Reduce inertial parameters to the fewest essential components, within an energy error.

    Components are found and ordered on the states of the space; errors are judged on others, since on the same states
    they would be too small.

    Parameters
    ----------
    space : EssentialSpace
        Essential space; the energies of its states weight the components.
    parameters : Mechanism or array_like
        Inertial parameters (P,) in SI units, without friction, or a mechanism that has them.
    energy_error : float, optional
        Largest energy error in percent; the fewest components within it are kept. None where `components` are given.
    components : int, optional
        Number of components to keep, from 0 to the rank; None where `energy_error` is given.
    states : States, optional
        States on which errors are judged; 20,000 others of the space's distribution by default, or the space's own
        where it has none, as for a recorded motion.

    Returns
    -------
    Reduction
        Components, weights and errors.

    Raises
    ------
    InputError
        If both or neither of error and number are given, one is out of range, or the parameters have a wrong shape, are
        not finite or make no energy differences.

    Examples
    --------
    >>> adaptctl.reduce(space, arm, energy_error=1.0).percent_error <= 1.0
    True
    """
    validate_kind(space, EssentialSpace, "reduce", "as essential_space(mechanism) gives one")
    if (energy_error is None) == (components is None):
        raise InputError("give either energy_error (percent) or components (a number)")
    if isinstance(parameters, Mechanism):
        parameters = np.asarray(parameters.inertial_parameters)[: parameters.num_energy_parameters]
    D = frozen_array(parameters, (len(space.parameter_names),), "parameters")
    alpha = space.basis.T @ D
    beta = space.singular_values[: space.rank] * alpha
    order = np.argsort(-np.abs(beta), kind="stable")
    parts = alpha[order, None] * space.basis[:, order].T
    judged = _judged(space, parts, beta[order], states)
    count = _enough(judged.errors, energy_error) if energy_error is not None else components
    return Reduction(
        states=judged.states,
        components=frozen(parts),
        weights=frozen(beta[order]),
        order=tuple(order.tolist()),
        percent_errors=frozen(judged.errors),
        num_components=_checked_count(count, space.rank),
    )


class _Judged(NamedTuple):
    """Energy errors (k + 1,) in percent, and the origin of the states that they were judged on."""

    errors: Array
    states: str


def _judged(space: EssentialSpace, components: Array, weights: Array, states: States | None) -> _Judged:
    others = space.draw_others(JUDGED_STATES) if states is None else states
    if others is None:
        return _Judged(percent_errors(weights), f"{space.states}, to which the components were fitted")
    parts = energy_triangle(space.mechanism, others) @ components.T
    missing = np.cumsum(parts[:, ::-1], axis=1)[:, ::-1]
    return _Judged(_percentages(np.square(missing).sum(axis=0)), others.origin)


def percent_errors(weights: Array) -> Array:
    """Return the energy errors (k + 1,) in percent of the first 0, 1, ... k components by descending `weights`."""
    # Summed from the smallest, so that the last ones keep their digits.
    return _percentages(np.cumsum(weights[::-1] ** 2)[::-1])


def _percentages(missing: Array) -> Array:
    """Return percentages (k + 1,) of summed squares (k,) that components leave out, before each of them."""
    squares = np.append(missing, 0.0)
    if squares[0] == 0.0:
        raise InputError("these parameters have no energy in any of the states")
    return np.asarray(100.0 * np.sqrt(squares / squares[0]))


def _enough(errors: Array, energy_error: float) -> int:
    return int(np.argmax(errors <= finite_number(energy_error, "energy_error")))


def _checked_count(count: int | None, most: int) -> int:
    if isinstance(count, int | np.integer) and not 0 <= count <= most:
        raise InputError(f"components: expected 0..{most}, got {count}")
    if isinstance(count, bool):
        raise InputError(f"components: expected a whole number from 0 to {most}, got {count}")
    return whole_number(count, "components", 0, most)
