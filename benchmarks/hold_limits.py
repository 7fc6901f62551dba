"""The accepted limit of the sampling ratio beside that at which loops ring. Run: python -m benchmarks.hold_limits

On random arms, gains of a random shape are raised until the closed loop, simulated from a small velocity at rest, rings
at the worst configuration that the search found or at a random one; accepted gains are those of MAX_SAMPLING_RATIO.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Sinusoids, SlotineLi, sampling_ratio, typical_inertia
from adaptctl.control.gains.sampling_ratio import MAX_SAMPLING_RATIO
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Plant, SemiImplicitEuler, simulate_many
from benchmarks.stability import PERIOD, random_arm

ARMS, PLACES, BANDWIDTH, DURATION = 20, 15, 8.0, 0.5
FIRST, GROWN = 1e-7, 1e-7
"""rad/s at the start; rad: an error that says that velocities grow"""


def bisected(arm: Mechanism, damping: Array, places: Array, rounds: int = 9) -> float:
    """The least multiple of a damping with which the loop rings at any of the places (N, r), between 1/2 and 4."""
    model, rest = ReducedModel.full(arm), np.zeros_like(places)
    one = SlotineLi(model, BANDWIDTH, 1e-3 * damping, None, arm.inertial_parameters, control_period=PERIOD)  # type: ignore[arg-type]
    plant = Plant(arm, PERIOD, integrator=SemiImplicitEuler())
    still = [Sinusoids(p, 0.0 * p, 0.0 * p, 0.0 * p) for p in places]
    low, high = np.full(len(places), 0.5), np.full(len(places), 4.0)
    for _ in range(rounds):
        middle = np.sqrt(low * high)
        laws = [one.having({"damping": share * damping}) for share in middle]
        run = simulate_many(plant, laws, still, duration=DURATION, p=places, v=rest + FIRST, record_every=None)
        rings = ~(run.largest_error.max(axis=1) < GROWN)
        low, high = np.where(rings, low, middle), np.where(rings, middle, high)
    return float(np.sqrt(low * high).min())


def main() -> int:
    """Print a line per arm; 1 where an accepted limit is below 0.7 of the one at which a loop rings."""
    shares = []
    for seed in range(ARMS):
        started, rng = time.process_time(), np.random.default_rng(1000 + seed)
        arm = random_arm(rng)
        shape = typical_inertia(arm) * 10.0 ** rng.uniform(-0.7, 0.7, arm.dof)
        free = sampling_ratio(arm, shape, PERIOD)
        accepted = shape * (MAX_SAMPLING_RATIO - PERIOD * BANDWIDTH) / free.value
        places = np.vstack([free.p, sampled_configurations(arm, PLACES, seed=seed)])
        shares.append(1.0 / bisected(arm, accepted, places))
        print(f"arm {seed}: accepted {shares[-1]:.3f} of what rings, {time.process_time() - started:.1f} s", flush=True)
    print(f"{ARMS} arms: from {min(shares):.3f} to {max(shares):.3f}, median {np.median(shares):.3f}")
    return int(min(shares) < 0.7 or max(shares) >= 1.0)


if __name__ == "__main__":
    sys.exit(main())
