"""States at which a basis is checked against energies."""

from __future__ import annotations

import numpy as np

from adaptctl.dynamics import load
from adaptctl.identifiability.reduced_model import CHECKED_STATES, MAX_LOOP_OFFSET, _few_states


def test_trees_are_tried_anywhere_and_loops_where_following_them_is_short() -> None:
    tree, loop = load("puma560_measured"), load("semi_direct_drive")
    anywhere, about = _few_states(tree), _few_states(loop)
    assert len(anywhere) == len(about) == CHECKED_STATES
    assert np.abs(anywhere.p - tree.neutral_configuration).max() > 2.0 > MAX_LOOP_OFFSET
    assert 0.5 * MAX_LOOP_OFFSET < np.abs(about.p - loop.neutral_configuration).max() <= MAX_LOOP_OFFSET
