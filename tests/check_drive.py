"""Stops and faults of `drive` in large numbers: `make check-drive`.

Ctrl-C at random ticks, full speed towards the ends of a range with good and wrong estimates, faults of measurements.
Prints what was beyond a limit, and 1 is the exit code then.
"""

from __future__ import annotations

import sys
from collections import Counter
from contextlib import suppress

import numpy as np
from driven_robots import ARM, FAULTS, FaultyRobot, LyingReference, RecordedRobot

import adaptctl
from adaptctl.control import FadeIn

PERIOD, CENTER = 4e-3, np.array([0.3, 0.5])
REFERENCE = adaptctl.Sinusoids(center=CENTER, amplitude=[0.6, 0.6], frequency=[0.5, 0.8])
MODEL = adaptctl.ReducedModel(ARM)


def law(scale: float = 1.0) -> adaptctl.SlotineLi:
    """Learning controller from the true parameters times a factor."""
    own = {"initial": scale * MODEL.fundamental_parameters, "control_period": PERIOD}
    return adaptctl.SlotineLi(MODEL, 8.0, [6.0, 2.0], np.full(len(MODEL.names), 0.02), **own)


def stops(count: int, random: np.random.Generator) -> Counter[str]:
    """Planned stops at random ticks of a fast motion."""
    found: Counter[str] = Counter()
    own, path = law(), FadeIn(REFERENCE, CENTER, 3.0)(np.linspace(0.0, 5.0, 20001)).p
    for _ in range(count):
        robot = FaultyRobot(ARM, PERIOD, CENTER)
        robot.interrupted_at = int(random.integers(1, 1000))
        with suppress(KeyboardInterrupt):
            adaptctl.drive(robot, own, REFERENCE, 5.0)
        off = max(np.linalg.norm(path - p, axis=1).min() for p in np.array(robot.states)[::5, :2])
        found.update(robot.breaches or (["off the path"] if off > 0.01 else ["within limits, on the path"]))
    return found


def ends(count: int, random: np.random.Generator) -> Counter[str]:
    """Full speed towards the end of a range, with estimates of 1, 0, -1 and 3 times the truth."""
    found: Counter[str] = Counter()
    laws = [law(scale) for scale in (1.0, 1.0, 0.0, -1.0, 3.0)]
    for k in range(count):
        v = 5.5 * random.choice([-1.0, 1.0], 2) * random.permutation([1.0, random.uniform()])
        robot = RecordedRobot(ARM, PERIOD, CENTER)
        run = adaptctl.drive(robot, laws[k % len(laws)], LyingReference(CENTER, v), 5.0, from_zero=True)
        found.update(robot.breaches or ["the robot's own stop" if run.by_robot else "planned stop"])
    return found


def faults(count: int, random: np.random.Generator) -> Counter[str]:
    """Faults of random kind, tick and length."""
    found: Counter[str] = Counter()
    own, kinds = law(), [*FAULTS, "closed", "refused"]
    for k in range(count):
        robot = FaultyRobot(ARM, PERIOD, CENTER)
        robot.fault, length = kinds[k % len(kinds)], int(random.integers(1, 40))
        robot.faults = ((int(random.integers(1, 300)), length),)
        run = adaptctl.drive(robot, own, REFERENCE, 1.3)
        found.update(robot.breaches or ["the robot's own stop" if run.by_robot else run.stopped or "ridden out"])
    return found


def main(share: float = 1.0) -> int:
    """Exit code: 1 where a limit was not kept."""
    bad = False
    for kind, count in ((stops, 200), (ends, 1000), (faults, 200)):
        found = kind(max(1, round(share * count)), np.random.default_rng(0))
        print(f"{kind.__name__}: {dict(found)}", flush=True)
        bad = bad or any(name in found for name in ("torque", "rate", "range", "off the path"))
    return int(bad)


if __name__ == "__main__":
    sys.exit(main(*map(float, sys.argv[1:2])))
