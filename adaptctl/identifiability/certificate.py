"""Certificate of a rank."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from adaptctl.arrays import Array
from adaptctl.description.right_angles import NearRightAngle
from adaptctl.errors import RankError

Method = Literal["automatic", "svd", "transfers"]

MIN_GAP = 1e6
# Least sigma_k/sigma_1 of the scaled energy differences.
MIN_SINGULAR_VALUE_RATIO = 1e-9
# Values beyond the gap above this, relative to sigma_1, are named: they are more than round-off.
ROUND_OFF_RATIO = 1e-14
# Values beyond the gap above this, relative to sigma_1, are far more than round-off, and refuse the rank: 1e-11 of an
# angle, times a thousand where a small column is scaled up.
MAX_RESIDUAL_SINGULAR_VALUE = 1e-8
# Most singular values in a message.
MAX_LISTED_VALUES = 80


@dataclass(frozen=True)
class ResidualSingularValue:
    """
    Singular value counted as zero, but above round-off (1e-14 of the largest).

    Nothing is checked at construction.

    Parameters
    ----------
    value : float
        Ratio to the largest singular value, without a unit.
    parameters : tuple of str
        Names of at most four parameters that dominate its right singular vector; for a rank found joint by joint, one
        text with the name of the link.

    Examples
    --------
    >>> from adaptctl.identifiability import ResidualSingularValue
    >>> print(ResidualSingularValue(3e-12, ("link2.m", "link3.m")))
    3.0e-12 (link2.m, link3.m)
    """

    value: float
    parameters: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.value:.1e} ({', '.join(self.parameters)})"


@dataclass(frozen=True)
class Certificate:
    """
    Evidence for the rank k, the number of identifiable inertial parameters of a mechanism.

    The rank is found in independent ways, which must agree. Nothing is checked at construction: `failures` and
    `validate_accepted` judge it.

    Parameters
    ----------
    rank_energy : int
        Rank of the energy differences at `samples` random states.
    rank_doubled : int
        Rank of the energy differences at twice as many states.
    gap : float
        Ratio, without unit, of the singular values number k and k + 1, the latter taken as at least 1e-15 of the
        largest.
    relative_smallest : float
        Ratio, without unit, of the singular value number k to the largest.
    samples : int
        Random states of which the matrices are made.
    seed : int
        Seed that drew the states.
    null_residual : float
        Largest torque at other states due to a parameter change that is found to be unidentifiable, divided by the
        largest torque due to any change of the same size; without unit.
    residual_singular_values : tuple of ResidualSingularValue, optional
        Singular values after the first k that are above 1e-14 of the largest.
    near_right_angles : tuple of NearRightAngle, optional
        Angles between successive joint axes that are nearly multiples of 90 degrees.
    rank_torque : int, optional
        Rank of the torque regressor at random states; None (default) for the method "transfers".
    rank_geometry : int, optional
        Rank that follows from a tree's geometry; None (default) for the method "svd".
    rank_exact : int, optional
        Rank computed in exact arithmetic; None (default) where it was not asked for.
    proof_method : str, optional
        Arithmetic of `rank_exact`: "a prime field" or "60 digits"; empty by default, without a proof.
    taken_as_exact : tuple of str, optional
        Angles in rad and lengths in m that miss a special value by so little, 1e-11 rad or 1e-11 of the characteristic
        length, that every method takes it as meant.

    Notes
    -----
    With the method "transfers", `gap` and `relative_smallest` are the smallest of all joints: there the matrix has the
    energy changes as inertial parameters are moved from a joint's link to its parent.

    Examples
    --------
    >>> space.certificate.rank, space.certificate.failures
    (6, ())
    """

    rank_energy: int
    rank_doubled: int
    gap: float
    relative_smallest: float
    samples: int
    seed: int
    null_residual: float
    residual_singular_values: tuple[ResidualSingularValue, ...] = ()
    near_right_angles: tuple[NearRightAngle, ...] = ()
    rank_torque: int | None = None
    rank_geometry: int | None = None
    rank_exact: int | None = None
    proof_method: str = ""
    taken_as_exact: tuple[str, ...] = ()

    @property
    def rank(self) -> int:
        """Rank k, certified if `failures` is empty."""
        return self.rank_energy

    @property
    def failures(self) -> tuple[str, ...]:
        """Reasons, as texts, for which the rank is refused; empty if it is certified."""
        other, what = self._other
        ranks = (self.rank_energy, other, self.rank_doubled)
        largest = max((leftover.value for leftover in self.residual_singular_values), default=0.0)
        wrong = {
            f"the gap at {self.rank} is {self.gap:.1e}, below the required {MIN_GAP:.0e}": (self.gap < MIN_GAP),
            f"sigma_k/sigma_1 is {self.relative_smallest:.1e}, below the required {MIN_SINGULAR_VALUE_RATIO:.0e}": (
                self.relative_smallest < MIN_SINGULAR_VALUE_RATIO
            ),
            f"the ranks differ: energies {ranks[0]}, {what} {ranks[1]}, twice as many samples {ranks[2]}": (
                len(set(ranks)) > 1
            ),
            f"beyond the gap, a singular value is {largest:.1e} of sigma_1, far above round-off": largest
            > MAX_RESIDUAL_SINGULAR_VALUE,
            f"the ranks differ: energies {self.rank_energy}, exact over {self.proof_method} {self.rank_exact}": (
                self.rank_exact not in (None, self.rank_energy)
            ),
        }
        return tuple(text for text, holds in wrong.items() if holds)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Texts on findings for which the rank is not refused: residual singular values and nearly right angles."""
        residual_singular_values = [
            f"beyond the gap, {leftover} is above round-off" for leftover in self.residual_singular_values
        ]
        if not (near := self.near_right_angles):
            return tuple(residual_singular_values)
        pairs = f"{len(near)} pairs of joint axes are" if len(near) > 1 else "one pair of joint axes is"
        advice = "write the angles exactly"
        return (
            *residual_singular_values,
            f"{pairs} close to a right angle (rounded file?): {'; '.join(map(str, near))}; {advice}",
        )

    def __str__(self) -> str:
        return (
            f"rank {self.rank} by the energies of {self.samples} and of {2 * self.samples} states and by "
            f"{self._other[1]}; gap {self.gap:.1e}, sigma_k/sigma_1 {self.relative_smallest:.1e}"
            + (f"; confirmed exactly, over {self.proof_method}" if self.rank_exact is not None else "")
        )

    @property
    def _other(self) -> tuple[int | None, str]:
        if self.rank_geometry is not None:
            return self.rank_geometry, "geometry"
        return self.rank_torque, "torques"

    def validate_accepted(self, mechanism: str, spectrum: Array, suspects: Sequence[object] = ()) -> None:
        """
        Raise `RankError` if the rank is refused, that is if there are `failures`.

        Parameters
        ----------
        mechanism : str
            Name for the message.
        spectrum : numpy.ndarray
            Singular values (n,), scaled without a unit, in descending order, which the error carries.
        suspects : sequence, optional
            Possible causes, which the message lists. None by default.

        Raises
        ------
        RankError
            If `failures` is not empty.

        Examples
        --------
        >>> space.certificate.validate_accepted(arm.name, space.singular_values)  # raises no error
        """
        if not self.failures:
            return
        hints = "".join(f"; {suspect}" for suspect in suspects)
        raise RankError(
            f"{mechanism}: the rank cannot be certified: {'; '.join(self.failures)}{hints}. "
            "Scaled singular values divided by the largest: "
            f"{_listing(spectrum / spectrum.max(initial=1e-300), self.rank)}",
            tuple(spectrum.tolist()),
        )


def _listing(relative: Array, rank: int) -> str:
    if len(relative) <= MAX_LISTED_VALUES:
        return " ".join(f"{x:.1e}" for x in relative)
    first = max(0, rank - MAX_LISTED_VALUES // 2)
    shown = relative[first : first + MAX_LISTED_VALUES]
    return f"(from the {first + 1}th) " + " ".join(f"{x:.1e}" for x in shown)
