"""Lengths that are so nearly equal that it matters, of loops, and those that are near nothing instead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from adaptctl.identifiability.proof.exact_energies import ExactEnergies
from adaptctl.identifiability.proof.exact_geometry import loop_lengths, near_coincidences
from benchmarks.rank_oracle import five_bar


@pytest.mark.parametrize("share", [0.9, 1.0, 1.1])
def test_a_length_within_a_ten_thousandth_is_near_nothing_and_not_compared(share: float) -> None:
    """Of a mechanism so long that a ten thousandth of it is this share of the five-bar's shortest length."""
    mechanism = five_bar(np.random.default_rng(1)).mechanism()
    frames = ExactEnergies(mechanism).frames
    shortest, longer = sorted({x for x, _ in loop_lengths(mechanism.description, frames) if x > 0.0})[:2]
    vast = replace(frames, length=share * shortest / 1e-4)
    told = [text for text in near_coincidences(mechanism.description, vast) if f"the lengths {shortest:.10g} m" in text]
    assert len(told) == (shortest > 1e-4 * vast.length)
    assert all(f"{longer:.10g} m" in text for text in told)
