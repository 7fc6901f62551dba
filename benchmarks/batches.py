"""Processor time of an arm's step in `simulate_many`, over the number of arms: python -m benchmarks.batches [ROUNDS]

PUMAs that learn, Runge and Kutta's method, true parameters and a start of their own, with nothing recorded but errors'
summaries. What an arm costs ought not to depend on how many there are.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

import adaptctl
from adaptctl.simulation import RungeKutta4, simulate_many
from benchmarks.interleaved import Effort, Statement, race
from benchmarks.tasks import PERIOD, puma

ARMS = (512, 1024, 4096, 16_384)
ARM_STEPS = 1 << 23
"""Arms times control periods of a run: all runs do the same amount of work."""


def batch(arms: int) -> Callable[[], object]:
    """The run of so many arms."""
    task = puma()
    plant = adaptctl.Plant(task.arm, PERIOD, integrator=RungeKutta4())
    p, v = task.starts(arms)
    parameters = np.tile(task.arm.inertial_parameters, (arms, 1))
    duration = PERIOD * (ARM_STEPS // arms)

    def run() -> object:
        return simulate_many(
            plant,
            task.controller,
            task.reference,
            duration=duration,
            parameters=parameters,
            p=p,
            v=v,
            record_every=None,
        )

    return run


def main(rounds: int) -> None:
    """Print a line for each number of arms, and how it compares with the best."""
    raced = race({str(arms): Statement(batch(arms), work=ARM_STEPS) for arms in ARMS}, Effort(rounds, 0.0))
    best = min((raced.time(str(arms)).median, str(arms)) for arms in ARMS)[1]
    for arms in ARMS:
        time, ratio = raced.time(str(arms)), raced.ratio(str(arms), best)
        spread = f"{ratio.median:.2f} ({ratio.lower:.2f} to {ratio.upper:.2f})"
        print(f"{arms:>7,} arms: {1e9 * time.median:5.0f} ns per arm-step, {spread} times that of {best}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2] or ["9"]))
