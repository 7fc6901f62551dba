"""Runs that are judged only where they reached their end."""

from __future__ import annotations

from adaptctl.simulation.simulate_many import Rollouts


def whole(runs: Rollouts) -> Rollouts:
    """
    Return runs that reached their end.

    Parameters
    ----------
    runs : Rollouts
        Runs, which end early, without a word, where Ctrl-C was pressed.

    Returns
    -------
    Rollouts
        The same runs.

    Raises
    ------
    KeyboardInterrupt
        If the runs were cut off: a verdict on them would be false, and the program would go on.

    Examples
    --------
    >>> from adaptctl.simulation.whole_runs import whole
    >>> whole(adaptctl.simulate_many(plant, law, reference, duration=0.05)).complete
    True
    """
    if not runs.complete:
        raise KeyboardInterrupt
    return runs
