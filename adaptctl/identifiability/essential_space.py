"""Essential parameter space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen_array, random_seed
from adaptctl.caching import cached_property
from adaptctl.compilation.object_cache import kept
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, printable, validate_kind
from adaptctl.identifiability.certificate import Certificate, Method
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
    as_written: bool
    prove: bool | None
    samples: int
    seed: int

    @cached_property
    def inputs(self) -> list[str]:
        """Cache key: hashes of description and geometry, and the settings."""
        settings = self.method, self.as_written, self.prove, self.samples, self.seed
        return [self.mechanism.description.sha256, self.mechanism.geometry_sha256, *map(repr, settings)]

    @cached_property
    def found(self) -> CertifiedNullSpace:
        """Certified null space."""
        from adaptctl.identifiability.certification import certified  # a tenth of the time to the first torque

        return certified(self.mechanism, self.method, self.as_written, self.prove, self.samples, self.seed)

    def energies(self) -> Array:
        """Triangular factor (n, P), n at most P, of energy differences at the random states."""
        from adaptctl.identifiability.energy_matrix import EnergyFactor, energy_blocks
        from adaptctl.identifiability.sampling import random_halves

        some, _ = random_halves(self.mechanism, self.samples, np.random.default_rng(self.seed))
        return EnergyFactor.of(energy_blocks(self.mechanism, some)).triangle


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
    others : callable, optional
        Function that draws a number of other states, on which `reduce` judges errors; None where `energies` are of
        states that cannot be drawn again.

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
    others: Callable[[int], States] | None = None

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
        """Orthonormal basis (P, P-k) of the parameter changes that change no torque, in SI units."""
        return self._null_vectors(self._bases[0], "null basis")

    @cached_property
    def singular_values(self) -> Array:
        """Singular values (P,) of the energy differences, descending, in J per SI unit."""
        of_search = self.energies is None
        compute = self._singular_values
        found = kept("singular values", self.search.inputs, list[float], compute) if of_search else compute()
        return frozen_array(found, (len(self.parameter_names),), "singular values")

    @cached_property
    def basis(self) -> Array:
        """Basis (P, k) of the identifiable directions: right singular vectors of the largest singular values."""
        complement = self._bases[1]
        V1 = complement @ right_vectors(self.triangle @ complement)
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
    def triangle(self) -> Array:
        """Triangular factor (n, P), n at most P, of the energy differences in J per SI unit."""
        return (self.energies or self.search.energies)()

    def draw_others(self, samples: int) -> States | None:
        """
        Draw new random states, of the same distribution as those of the singular values.

        Parameters
        ----------
        samples : int
            Number of states, at least 2.

        Returns
        -------
        States or None
            States; None where their kind is not known, as of a recorded motion.

        Examples
        --------
        >>> len(space.draw_others(100))
        100
        """
        if self.others is not None:
            return self.others(samples)
        return None if self.energies is not None else _other_random_states(self.search, samples)

    def _singular_values(self) -> list[float]:
        return singular_values(self.triangle).tolist()

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
    as_written: bool = False,
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
        random ones by default. The rank and the null space do not depend on them.
    method : {"automatic", "svd", "transfers"}, default "automatic"
        "svd" decomposes energies at random states; "transfers" follows a tree's geometry joint by joint, in time
        proportional to its length. "automatic" takes transfers for trees of 100 parameters or more.
    as_written : bool, default False
        If true, angles and offsets that are nearly special (see Notes) are meant as they stand, as those of a robot
        loaded ``as_written``. By default they are refused where they change the rank, as they mostly are rounded.
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
    if not mechanism.unconstrained.num_energy_parameters:
        raise InputError(f"{mechanism.name}: no link has inertia: all are massless")
    seed = random_seed(seed, "seed")
    given = None if states is None else partial(_same, energy_triangle(mechanism, states))
    search = Search(
        mechanism,
        method,
        _as_written(as_written) or mechanism.description.as_written,
        _proof_asked(prove),
        _sample_count(samples, mechanism.num_energy_parameters),
        seed,
    )
    inputs, kind = search.inputs, tuple[Certificate, str]
    certificate, random = kept("certificate", inputs, kind, lambda: (search.found.certificate, search.found.states))
    if states is None:
        return EssentialSpace(search, certificate, random)
    return EssentialSpace(search, certificate, states.origin, given, states.others)


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


def _as_written(asked: bool) -> bool:
    if isinstance(asked, bool | np.bool_):
        return bool(asked)
    raise InputError(f"as_written: expected True or False, got {printable(repr(asked))}")


def _same(energies: Array) -> Array:
    return energies


def _other_random_states(search: Search, samples: int) -> States:
    from adaptctl.identifiability.sampling import other_random_states

    return other_random_states(search.mechanism, search.seed, samples)


def energy_triangle(mechanism: Mechanism, states: States) -> Array:
    """Triangular factor (n, P) of the energy differences of states."""
    from adaptctl.identifiability.energy_matrix import EnergyFactor, energy_blocks
    from adaptctl.identifiability.sampling import States

    if not isinstance(states, States):
        raise InputError(f"states: expected States or None, got {printable(repr(states))}")

    return EnergyFactor.of(energy_blocks(mechanism, [states])).triangle
