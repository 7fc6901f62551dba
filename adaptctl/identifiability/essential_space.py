"""The essential parameter space: the combinations of inertial parameters that a mechanism's motion depends on."""

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


CERTIFIED = ("rank_energy", "rank_doubled", "gap", "relative_smallest", "samples", "null_residual")
"""Entries of a certificate in a notebook's view."""


@dataclass(frozen=True, eq=False)
class Search:
    """The settings of a search for the null space of a mechanism's energies, the directions of its inertial parameters
    that change no energy, and its result, `found`, computed when that attribute is first read.

    `method` is "svd" (singular values of energies at random states), "transfers" (a tree's geometry, joint by joint) or
    "automatic": transfers for a tree of 100 parameters or more if they can certify the rank, else "svd". `samples` is
    the number of random states, `seed` draws them. `prove` True also computes the rank on exact geometry, False does
    not; None does so for trees, and for closed loops only where some geometry is nearly special: an angle within 1e-3
    rad of a multiple of 90 degrees, or an offset within 1e-4 of the characteristic length of zero or of another, that
    is not exact to 1e-11. `near` is for such geometry, unless `prove` is False: "refuse" makes `found` raise
    `RankError` if the rank would be another with these exact, "as_is" takes them as they stand.

    Nothing is checked at construction: reading `found` raises `RankError` where the rank cannot be certified or is
    refused, `InputError` for another `method` or `near`, for fewer than 2 `samples`, and for "transfers" of a mechanism
    with loops, constrained parameters, or drives that turn with several joints.
    """

    mechanism: Mechanism
    method: Method
    near_singular: Near
    prove: bool | None
    samples: int
    seed: int

    @cached_property
    def inputs(self) -> list[str]:
        """The key under which results of this search are cached: a list of seven texts with all that they depend on.
        They are the SHA-256 hashes (hexadecimal) of the mechanism's description and of its geometry, which counts
        linear constraints on parameters, then the search's settings `method`, `near`, `prove`, `samples` and `seed`, as
        Python's repr writes them."""
        settings = self.method, self.near_singular, self.prove, self.samples, self.seed
        return [self.mechanism.description.sha256, self.mechanism.geometry_sha256, *map(repr, settings)]

    @cached_property
    def found(self) -> CertifiedNullSpace:
        """The certified null space, a `CertifiedNullSpace`: the directions of the mechanism's inertial parameters that
        change no energy, the certificate of their number, its proof on exact geometry if there is one, and the energies
        behind them. Raises `RankError` where the rank cannot be certified or is refused, `InputError` for an unknown
        `method` or `near`, and for "transfers" where the mechanism has loops, constrained parameters, or drives that
        turn with several joints."""
        from adaptctl.identifiability.certification import certified  # a tenth of the time to the first torque

        return certified(self.mechanism, self.method, self.near_singular, self.prove, self.samples, self.seed)


@dataclass(frozen=True, eq=False)
class EssentialSpace:
    """The essential space of inertial parameters D (P,), in SI units, without friction: the k of their P directions
    that change energies and torques, and the complement, the null space, which changes none.

    `singular_values` (P,) and `basis` V1 (P, k) are those of the matrix H (samples - 1, P) of differences of kinetic
    plus potential energy between successive ones of `samples` states, in J per SI unit of each parameter, not scaled
    (Sheu and Walker 1991, section 3). `null_basis` V2 (P, P-k) is orthonormal and does not depend on the states.
    `scales` (P,) make parameters comparable: choices between parameters of different units are made on D / scales,
    whose null vectors are `scaled_null_basis` (P, P-k). Arrays are computed when first asked for, and are read-only.

    `search` holds the mechanism and the settings by which the null space is found, `certificate` the evidence for its
    rank k, `states` says in words where the states of H come from, and `energies()` returns the triangular factor R (n,
    P), n at most P, of H = Q R, Q orthonormal, in the units of H; None for the random states of the search. Made by
    `essential_space`; nothing is checked at construction.
    """

    search: Search
    certificate: Certificate
    states: str
    energies: Callable[[], Array] | None = None

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism whose inertial parameters the space describes."""
        return self.search.mechanism

    @property
    def null_space(self) -> NullSpace:
        """The null space of the mechanism's energies, the directions of the P inertial parameters D that change none.
        Its members are the rank `rank` k, `scales` (P,), `null_basis` (P, P-k) of orthonormal vectors among D / scales,
        and `regrouping`, a method that removes P-k parameters in an order and regroups them onto the others."""
        return self.search.found.null_space

    @property
    def proof(self) -> ExactEnergies | None:
        """The mechanism's energies on exact geometry, as `ExactEnergies`, from which the rank of the essential space
        was computed a second time, in exact arithmetic (60 digits for closed loops).

        None where that was left out: where `essential_space` was called with `prove` False, or, for closed loops, with
        `prove` None and no angle within 1e-3 rad of a multiple of 90 degrees, and no offset within 1e-4 of the
        characteristic length of zero or of another, that is not exact to 1e-11.
        """
        return self.search.found.proof

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P inertial parameters, all but friction, such as ``link3.I_xx``, in the mechanism's order."""
        return self.mechanism.parameter_names[: self.mechanism.num_energy_parameters]

    @property
    def rank(self) -> int:
        """The rank k: the number of independent directions of the P inertial parameters (all but friction) that change
        energies and torques."""
        return self.certificate.rank

    @cached_property
    def scales(self) -> Array:
        """The scales (P,), read-only, in SI units per J, that make the P inertial parameters D comparable: D / scales
        are all in J.

        A parameter's scale is 1/e, where e is the root of the summed squares of the energies that a unit of it has at
        46 random states. Where e is below 1e-3 of the largest (units counted in the characteristic length), that floor
        replaces it.
        """
        return frozen_array(self.null_space.scales, (len(self.parameter_names),), "scales")

    @cached_property
    def scaled_null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k), without a unit, k the rank: directions of the P scaled inertial parameters
        D / scales (in J, without friction; `scales` is this object's property) that change no energy and no torque."""
        return self._null_vectors(self.null_space.null_basis, "scaled null basis")

    @cached_property
    def null_basis(self) -> Array:
        """Orthonormal null vectors V2 (P, P-k), k the rank: directions of the P inertial parameters D (without
        friction), as values in SI units, that change no energy and no torque."""
        return self._null_vectors(self._bases[0], "null basis")

    @cached_property
    def singular_values(self) -> Array:
        """Singular values (P,), in descending order, of the matrix H (samples - 1, P) of differences of kinetic plus
        potential energy between successive ones of `samples` states, in J per SI unit of each of the P inertial
        parameters, which are not scaled."""
        return frozen_array(singular_values(self._triangle), (len(self.parameter_names),), "singular values")

    @cached_property
    def basis(self) -> Array:
        """Orthonormal right singular vectors V1 (P, k), without a unit, of the k largest singular values, in their
        order, k the rank, of the matrix H (samples - 1, P). H has the differences of kinetic plus potential energy
        between successive ones of `samples` states, one column for each of P inertial parameters in SI units."""
        complement = self._bases[1]
        V1 = complement @ right_vectors(self._triangle @ complement)
        return frozen_array(V1, (len(self.parameter_names), self.rank), "basis")

    def _repr_html_(self) -> str:
        """Notebook's view of the space: its rank, and its certificate."""
        rows = [(name.replace("_", " "), f"{getattr(self.certificate, name):.4g}") for name in CERTIFIED]
        text = f"rank {self.rank} of {len(self.parameter_names)} parameters of {self.mechanism.name}"
        return titled("EssentialSpace", text) + table(("certificate", ""), rows)

    def project(self, parameters: ArrayLike) -> Array:
        """Essential parameters D_E = V1 V1' D (..., P) of P inertial parameters D (..., P) without friction, in SI
        units: D without its part in the null space, which changes no energy. V1 (P, k) is this object's `basis`, V1'
        its transpose, k the rank. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity."""
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
    """The essential parameter space of a mechanism: the k directions of its P inertial parameters (all but friction)
    that change energies and torques.

    By the method "svd" it comes from energies at random states, drawn by `seed` (0 to 2^32 - 1); `samples` is their
    number, at least 2 P, 2 P + 1 where None. By "transfers", for trees alone, its null space, the directions that
    change nothing, follows from the geometry, joint by joint, in time that grows with the number of links, and it is
    checked against sampled energies. "automatic" takes transfers for trees of a hundred parameters or more if their
    rank k can be certified so, and else "svd". With `states`, the singular values and their vectors V1 (P, k) are those
    of the given states' energies, so that model reduction holds for them; None takes the random ones. The rank k and
    the null vectors V2 (P, P-k) are the mechanism's own and do not depend on them.

    `near` is for angles within 1e-3 rad of a multiple of 90 degrees, or offsets within 1e-4 of the characteristic
    length of zero (in loops also of one another), that are not exact to 1e-11, where the rank would be another one if
    they were: "refuse" raises `RankError`, "as_is" takes the geometry as it stands; `prove` False looks for none. With
    `prove` the rank is also computed on exact geometry; None does so for trees, and for closed loops, which take long,
    only where there are such angles or lengths; False leaves it out.

    Raises `RankError` when the rank cannot be certified, with the singular values, or is refused, and `InputError` for
    a `method` that is unknown or not for this mechanism, for another `near`, `prove` or `seed`, for `samples` that are
    too few or no whole number, and for `states` that are no `States`, or of another number of joints.
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
    num_components: int

    @property
    def percent_error(self) -> float:
        """The energy error, in percent, of the reduced parameters D', the sum of the kept components: 100 |H (D' - D)|
        / |H D| for the parameters D. H D are the differences (J) of kinetic plus potential energy between successive
        states, and |.| is the root of the summed squares."""
        return float(self.percent_errors[self.num_components])

    def parameters(self, components: int | None = None) -> Array:
        """Reduced values (P,) of the P inertial parameters in SI units, without friction: the sum of the first
        `components` of the k essential components, those with the largest weights; of all that are kept where None.

        The components are the parts (P,) of the parameters along the k directions that change energies. Raises
        `InputError` unless `components` is a whole number from 0 to k.
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
    validate_kind(space, EssentialSpace, "reduce", "as essential_space(mechanism) gives one")
    if (energy_error is None) == (components is None):
        raise InputError("give one of energy_error, in percent, and components, a number")
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
    """Energy errors (k + 1,) in percent, when only the first 0, 1, ... k of k essential components are kept whose sizes
    `weights` (k,), J, descend (Sheu and Walker 1991, equation 23). Raises `InputError` where all are zero."""
    # Summed from the smallest, so that the last ones keep their digits.
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
