"""Residues modulo a large prime: they reckon as fractions do."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from adaptctl.identifiability.proof.arithmetic import PRIME, Modular, modular, ranks, residue

fractions = st.fractions(-1000, 1000, max_denominator=10**6)


@given(fractions, fractions)
def test_residues_reckon_like_fractions(x: Fraction, y: Fraction) -> None:
    a, b = Modular(np.array([residue(x)])), Modular(residue(y))
    for found, meant in ((a + b, x + y), (a - b, x - y), (a * b, x * y), (-a, -x), (a + 0.5, x + Fraction(1, 2))):
        assert int(found.residues[0]) == residue(meant)
    for found, meant in ((0.5 - a, Fraction(1, 2) - x), (2.0 * a, 2 * x), (a / 4.0, x / 4)):
        assert int(found.residues[0]) == residue(meant)
    if y:
        assert int((a / b).residues[0]) == residue(x / y)
        assert (1.0 / b).residues == residue(1 / y)
    assert 0.0 * a == 0.0
    assert [modular(Fraction(n)) for n in (-1, 0, 1)] == [-1.0, 0.0, 1.0]  # floats, which cost nothing


def test_ranks_of_small_matrices_are_those_of_their_factors() -> None:
    """Also of zero, and where the first column is."""
    rng = np.random.default_rng(0)
    for rows, columns in ((3, 3), (3, 5), (5, 3)):
        made = [rng.integers(1, 9, (rows, k)) @ rng.integers(1, 9, (k, columns)) for k in range(4)]
        made += [one * (np.arange(columns) > 0) for one in made]
        expected = [int(np.linalg.matrix_rank(one)) for one in made]
        assert list(ranks(np.array(made) % PRIME)) == expected


def test_the_modulus_is_a_prime_whose_products_fit_and_of_which_no_square_is_minus_one() -> None:
    """It is large too: residues of two numbers that differ are equal by chance once in two milliards."""
    assert np.all(PRIME % np.arange(2, int(np.sqrt(PRIME)) + 2) != 0)
    assert PRIME > 2 * 10**9
    assert (PRIME - 1) ** 2 < 2**63
    assert PRIME % 4 == 3
