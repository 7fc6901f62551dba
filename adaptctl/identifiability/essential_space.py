"""Essential parameter space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen, frozen_array, real_number, whole_number
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.compilation.object_cache import kept
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, printable, validate_kind
from adaptctl.identifiability.certificate import Certificate, Method, Near
from adaptctl.identifiability.factorisation import right_vectors, singular_values
from adaptctl.identifiability.regrouping import NullSpace, unscaled_bases
from adaptctl.markup import table, titled

if TYPE_CHECKING:
    from adaptctl.identifiability.certification import CertifiedNullSpace
    from adaptctl.identifiability.proof.exact_energies import ExactEnergies
    from adaptctl.identifiability.sampling import States


# Entries of a certificate in a notebook's view.
CERTIFIED = ("rank_energy", "rank_doubled", "gap", "relative_smallest", "samples", "null_residual")


@dataclass(frozen=True, eq=False)
class Search:
    """Search for the null space of a mechanism's energies, with its result."""

    mechanism: Mechanism
    method: Method
    near_singular: Near
    prove: bool | None
    samples: int
    seed: int

    @cached_property
    def inputs(self) -> list[str]:
        """Cache key: hashes of description and geometry, and the settings."""
        settings = self.method, self.near_singular, self.prove, self.samples, self.seed
        return [self.mechanism.description.sha256, self.mechanism.geometry_sha256, *map(repr, settings)]

    @cached_property
    def found(self) -> CertifiedNullSpace:
        """Certified null space."""
        from adaptctl.identifiability.certification import certified  # a tenth of the time to the first torque

        return certified(self.mechanism, self.method, self.near_singular, self.prove, self.samples, self.seed)


@dataclass(frozen=True, eq=False)
class EssentialSpace:
    """
    Identifiable directions of inertial parameters, which change energies and torques, and their null space.

    `essential_space` makes it. Arrays are computed when first read and are read-only. Nothing is checked at
    construction.

    Parameters
    ----------
    search : Search
        Mechanism, and settings of the search for its null space.
    certificate : Certificate
        Evidence for the rank k.
    states : str
        Origin, in words, of the states from which the singular values are computed.
    energies : callable, optional
        Function that returns the triangular factor (n, P), n at most P, of the states' energy differences in J per SI
        unit. Default: those of the search's random states.

    Notes
    -----
    The matrix :math:`H` (samples - 1, P) has the differences of kinetic plus potential energy between successive
    states, in J per SI unit of each parameter [1]_. `basis` :math:`V_1` (P, k) and `singular_values` are those of
    :math:`H`; `null_basis` :math:`V_2` (P, P-k) does not depend on the states. Friction is not among the P parameters.

    References
    ----------
    .. [1] Sheu and Walker, 1991. Identifying the independent inertial parameter space of robot manipulators.
       International Journal of Robotics Research, section 3.

    Examples
    --------
    >>> space.rank, space.basis.shape, space.null_basis.shape
    (6, (20, 6), (20, 14))
    """

    search: Search
    certificate: Certificate
    states: str
    energies: Callable[[], Array] | None = None

    def __repr__(self) -> str:
        return (
            f"<EssentialSpace of {self.mechanism.name!r}: rank {self.rank} of {len(self.parameter_names)} parameters>"
        )

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism whose inertial parameters the space describes."""
        return self.search.mechanism

    @property
    def null_space(self) -> NullSpace:
        """Parameter changes that change no energy, with their scales."""
        return self.search.found.null_space

    @property
    def proof(self) -> ExactEnergies | None:
        """Proof of the rank in exact arithmetic; None where it was not made."""
        return self.search.found.proof

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P inertial parameters, without friction."""
        return self.mechanism.parameter_names[: self.mechanism.num_energy_parameters]

    @property
    def rank(self) -> int:
        """Rank k: number of identifiable directions."""
        return self.certificate.rank

    @cached_property
    def scales(self) -> Array:
        """Scales (P,) of the parameters in SI units per J, with which they make comparable energies."""
        return frozen_array(self.null_space.scales, (len(self.parameter_names),), "scales")

    @cached_property
    def scaled_null_basis(self) -> Array:
        """Orthonormal basis (P, P-k), as `null_basis`, for parameters divided by `scales`."""
        return self._null_vectors(self.null_space.null_basis, "scaled null basis")

    @cached_property
    def null_basis(self) -> Array:
        """Orthonormal basis V2 (P, P-k) of the parameter changes that change no torque, in SI units."""
        return self._null_vectors(self._bases[0], "null basis")

    @cached_property
    def singular_values(self) -> Array:
        """Singular values (P,) of H, descending, in J per SI unit."""
        return frozen_array(singular_values(self._triangle), (len(self.parameter_names),), "singular values")

    @cached_property
    def basis(self) -> Array:
        """Right singular vectors V1 (P, k) of the k largest singular values."""
        complement = self._bases[1]
        V1 = complement @ right_vectors(self._triangle @ complement)
        return frozen_array(V1, (len(self.parameter_names), self.rank), "basis")

    def _repr_html_(self) -> str:
        rows = [(name.replace("_", " "), f"{getattr(self.certificate, name):.4g}") for name in CERTIFIED]
        text = f"rank {self.rank} of {len(self.parameter_names)} parameters of {self.mechanism.name}"
        return titled("EssentialSpace", text) + table(("certificate", ""), rows)

    def project(self, parameters: ArrayLike) -> Array:
        """
        Project inertial parameters on the essential space, which leaves all torques unchanged.

        Parameters
        ----------
        parameters : array_like
            Inertial parameters (..., P) in SI units, without friction.

        Returns
        -------
        numpy.ndarray
            Parameters (..., P) in SI units, with the same energies and torques.

        Raises
        ------
        InputError
            If the shape is wrong (`NonFiniteError` for NaN and infinity).

        Examples
        --------
        >>> space.project(np.ones(20)).shape
        (20,)
        """
        return (checked(parameters, len(self.parameter_names), "parameters") @ self.basis) @ self.basis.T

    @cached_property
    def _triangle(self) -> Array:
        return (self.energies or self.search.found.energies)()

    @cached_property
    def _bases(self) -> tuple[Array, Array]:
        return unscaled_bases(self.null_space.null_basis, self.null_space.scales)

    def _null_vectors(self, vectors: Array, what: str) -> Array:
        P = len(self.parameter_names)
        return frozen_array(vectors, (P, P - self.rank), what)


def essential_space(
    mechanism: Mechanism,
    *,
    samples: int | None = None,
    seed: int = 0,
    states: States | None = None,
    method: Method = "automatic",
    near_singular: Near = "refuse",
    prove: bool | None = None,
) -> EssentialSpace:
    """
    Compute the directions of a mechanism's inertial parameters that change energies and torques.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with P inertial parameters, without friction; any tree or closed loops.
    samples : int, optional
        Number of random states, at least 2 P. Default: 2 P + 1, twice as many differences as unknowns.
    seed : int, default 0
        Seed of the states, from 0 to 2^32 - 1. Fixed, so that a result can be repeated.
    states : States, optional
        States whose energies give singular values and vectors, so that model reduction holds for this motion; the
        random ones by default. Rank and null vectors do not depend on them.
    method : {"automatic", "svd", "transfers"}, default "automatic"
        "svd" decomposes energies at random states; "transfers" follows a tree's geometry joint by joint, in time
        proportional to its length. "automatic" takes transfers for trees of 100 parameters or more.
    near_singular : {"refuse", "as_is"}, default "refuse"
        Treatment of angles and offsets that are nearly special (see Notes), for which the rank would change if they
        were exact. Refused by default, as they mostly are rounded numbers.
    prove : bool, optional
        If true, the rank is also computed in exact arithmetic. By default (None) this is done for trees, and for loops
        with nearly special geometry; if false, never, and nearly special geometry is not looked for.

    Returns
    -------
    EssentialSpace
        Space of rank k with its certificate.

    Raises
    ------
    RankError
        If the rank cannot be certified or is refused; the error carries the singular values.
    InputError
        If an argument is unknown, out of range, or not for this mechanism.

    Notes
    -----
    Nearly special are angles within 1e-3 rad of a multiple of 90 degrees, and offsets within 1e-4 of the characteristic
    length of zero (in loops also of one another), that are not exact to 1e-11.

    Examples
    --------
    >>> adaptctl.essential_space(arm).rank
    6
    """
    validate_kind(mechanism, Mechanism, "essential_space", "as load(...) gives one")
    seed = whole_number(seed, "seed", 0, 2**32 - 1)
    given = None if states is None else partial(_same, _triangle(mechanism, states))
    search = Search(
        mechanism,
        method,
        near_singular,
        _proof_asked(prove),
        _sample_count(samples, mechanism.num_energy_parameters),
        seed,
    )
    inputs, kind = search.inputs, tuple[Certificate, str]
    certificate, random = kept("certificate", inputs, kind, lambda: (search.found.certificate, search.found.states))
    return EssentialSpace(search, certificate, random if states is None else states.origin, given)


def _sample_count(asked: int | None, parameters: int) -> int:
    if asked is None:
        return 2 * max(parameters, 1) + 1
    if not isinstance(asked, int | np.integer) or asked < 2 * parameters:
        given = printable(repr(asked))
        raise InputError(f"samples: expected a whole number, at least twice the {parameters} parameters, got {given}")
    return int(asked)


def _proof_asked(prove: bool | None) -> bool | None:
    if prove is None or isinstance(prove, bool | np.bool_):
        return prove if prove is None else bool(prove)
    raise InputError(f"prove: expected True, False or None, got {printable(repr(prove))}")


def _same(energies: Array) -> Array:
    return energies


def _triangle(mechanism: Mechanism, states: States) -> Array:
    from adaptctl.identifiability.energy_matrix import EnergyFactor, energy_blocks
    from adaptctl.identifiability.sampling import States

    if not isinstance(states, States):
        raise InputError(f"states: expected States or None, got {printable(repr(states))}")

    return EnergyFactor.of(energy_blocks(mechanism, [states])).triangle


@sent_as_made
@dataclass(frozen=True, eq=False)
class Reduction:
    """
    Inertial parameters as a sum of essential components, of which the most important are kept.

    `reduce` makes it, for given parameters and states. Arrays are read-only; nothing is checked at construction.

    Parameters
    ----------
    states : str
        Origin, in words, of the states for which the errors hold.
    components : numpy.ndarray
        Components (k, P) in SI units, in descending order of the size of their weights.
    weights : numpy.ndarray
        Weights (k,) in J. The size of a weight is the root of the sum of squares of the component's energy differences.
    order : tuple of int
        Column (k,) of the space's `basis` of each component.
    percent_errors : numpy.ndarray
        Energy errors (k + 1,) in percent if only the first 0, 1, ... k components are kept.
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
        Return the sum of the most important components.

        Parameters
        ----------
        components : int, optional
            Number of components, from 0 to k; those that are kept by default.

        Returns
        -------
        numpy.ndarray
            Reduced inertial parameters (P,) in SI units, without friction.

        Raises
        ------
        InputError
            If the number is out of range.
        """
        count = self.num_components if components is None else _checked_count(components, len(self.weights))
        return self.components[:count].sum(axis=0)


def reduce(
    space: EssentialSpace,
    parameters: Mechanism | ArrayLike,
    *,
    energy_error: float | None = None,
    components: int | None = None,
) -> Reduction:
    """
    Reduce inertial parameters to the fewest essential components, within an energy error.

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
    errors = percent_errors(beta[order])
    count = _enough(errors, energy_error) if energy_error is not None else components
    return Reduction(
        states=space.states,
        components=frozen(alpha[order, None] * space.basis[:, order].T),
        weights=frozen(beta[order]),
        order=tuple(order.tolist()),
        percent_errors=frozen(errors),
        num_components=_checked_count(count, space.rank),
    )


def percent_errors(weights: Array) -> Array:
    """Return the energy errors (k + 1,) in percent of the first 0, 1, ... k components by descending `weights`."""
    # Summed from the smallest, so that the last ones keep their digits.
    tails = np.append(np.cumsum(weights[::-1] ** 2)[::-1], 0.0)
    if tails[0] == 0.0:
        raise InputError("these parameters have no energy in any of the states")
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
