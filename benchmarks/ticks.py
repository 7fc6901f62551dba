"""Time of a tick of every control law with every adaptation law, on the PUMA 560 as measured.

    python benchmarks/ticks.py [ROUNDS]

The same equation runs on Python floats, on NumPy arrays of one sample, as native code called from Python
(`Controller.step`), and as native code that calls itself: one arm, and arms in SIMD lanes. All take turns; each time is
the median of its rounds, in the processor's own time, so that other work on the machine counts little.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from adaptctl import control
from adaptctl.compilation import Ensemble, compile_step
from adaptctl.control import Controller, ReferencePoint
from adaptctl.control.pytree import leaves, like
from adaptctl.dynamics import load
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column

ROBOT = "puma560_measured"
ARMS, PERIODS, CALLS = 64, 100, 200
"""Arms in lanes, native ticks of each, and calls from Python, a round."""

Ticks: TypeAlias = Callable[[], int]
"""Something to be timed; it returns how many ticks it took."""


class Tick(NamedTuple):
    """Seconds of a tick, and the floating-point operations of the native one."""

    name: str
    flops: int
    floats: float
    arrays: float
    called: float
    native: float
    lanes: float


def controllers() -> Iterator[tuple[str, Controller[Any]]]:
    """Controllers by name: every control law with every adaptation law that it takes, from true parameters."""
    mechanism = load(ROBOT)
    model = ReducedModel(mechanism)
    gains = control.Gains.from_bandwidth(mechanism, 8.0)
    yield "PDGravity", control.PDGravity(mechanism, gains.bandwidth * gains.damping, gains.damping)
    yield "ComputedTorque", control.ComputedTorque(mechanism, gains.bandwidth)
    for name, law, known in adaptations(model):
        true = known.regrouping @ mechanism.inertial_parameters
        for kind in (control.SlotineLi, control.PassivityIntegral, control.TaskSpaceSlotineLi):
            yield f"{kind.__name__}, {name}", kind(known, gains.bandwidth[0], gains.damping, law, true)
        yield f"AdaptiveComputedTorque, {name}", control.AdaptiveComputedTorque(known, gains.bandwidth, true, law)


def adaptations(model: ReducedModel) -> Iterator[tuple[str, Any, ReducedModel]]:
    """Adaptation laws with the parameters they adapt: 36, or all 60 for the natural one."""
    gain, k = control.adaptation_gain(model), len(model.columns)
    yield "none", None, model
    for simple in (control.Gradient, control.SigmaModification, control.EModification, control.DeadZone):
        yield simple.__name__, simple(gain), model
    yield "Projection", control.Projection(control.Gradient(gain), np.full(k, -1e3), np.full(k, 1e3)), model
    yield "Subspace of 10", control.Subspace(np.ones(10), np.random.default_rng(0).normal(size=(k, 10))), model
    for filtering in (control.Composite, control.BoundedGainForgetting, control.CushionedFloor):
        yield filtering.__name__, filtering(gain), model
    for learning in (control.CompositeLearning, control.ConcurrentLearning):
        yield learning.__name__, learning(gain), model
    first = np.asarray(model.mechanism.inertial_parameters)
    yield "ConsistentAdaptation", control.ConsistentAdaptation(0.01, first), model
    yield "ConsistentAdaptation, predicting", control.ConsistentAdaptation(0.01, first, 1.0), model
    yield "Natural, 60", control.Natural(0.01), ReducedModel.full(model.mechanism)


def ticks(controller: Controller[Any], seed: int = 0) -> tuple[int, tuple[Ticks, ...]]:
    """The operations of a tick, and the ways to take one, in the order of `Tick`."""
    p, v, *reference = np.random.default_rng(seed).normal(scale=0.1, size=(5, controller.dof))
    reference = [part[: controller.reference_size] for part in reference]
    first = controller.init(p, v)
    given = [p, v, *reference, *leaves(first)]
    ensembles = [_ensemble(controller, first, given, lanes) for lanes in (1, None)]

    def equation(columns: list[Column]) -> int:
        controller.law(columns[0], columns[1], ReferencePoint(*columns[2:5]), like(first, columns[5:]))
        return 1

    def called() -> int:
        for _ in range(CALLS):
            controller.step(first, p, v, ReferencePoint(*reference))
        return CALLS

    def native(ensemble: Ensemble) -> int:
        ensemble.run(PERIODS)
        return ARMS * PERIODS

    floats = [Column(np.asarray(part).tolist()) for part in given]
    arrays = [Column(np.asarray(part)[:, None]) for part in given]
    ways = lambda: equation(floats), lambda: equation(arrays), called, *(_bound(native, x) for x in ensembles)
    return ensembles[0].stepper.operations.flops, ways


def _ensemble(controller: Controller[Any], first: Any, given: list[Any], lanes: int | None) -> Ensemble:
    names = [f"x{i}" for i in range(len(given))]
    sizes = dict(zip(names, map(len, given), strict=True))

    def step(**columns: Column) -> tuple[Column, ...]:
        p, v, *rest = (columns[name] for name in names)
        torque, after = controller.law(p, v, ReferencePoint(*rest[:3]), like(first, rest[3:]))
        return (*leaves(after), torque)

    state, held = {name: sizes[name] for name in names[5:]}, {name: sizes[name] for name in names[:5]}
    ensemble = compile_step(step, state=state, constants=held, lanes=lanes).ensemble(ARMS)
    for name, values in zip(names, given, strict=True):
        (ensemble.state if name in state else ensemble.held)[name] = values
    return ensemble


def _bound(function: Callable[[Ensemble], int], ensemble: Ensemble) -> Ticks:
    return lambda: function(ensemble)


def measured(name: str, controller: Controller[Any], rounds: int) -> Tick:
    """The medians of one controller's ticks."""
    flops, ways = ticks(controller)
    for way in ways:
        way()
    found = [[_seconds(way) for way in ways] for _ in range(rounds)]
    return Tick(name, flops, *np.median(found, axis=0).tolist())


def _seconds(way: Ticks) -> float:
    started = time.thread_time()
    count = way()
    return (time.thread_time() - started) / count


def main(rounds: int) -> int:
    """Print a line per controller."""
    titles = "flops", "floats us", "arrays us", "step us", "native ns", "lanes ns", "floats/step", "floats/native"
    print(f"{'':48s}", *(f"{title:>{len(title) + 1}}" for title in titles))
    for name, controller in controllers():
        tick = measured(name, controller, rounds)
        numbers = (
            f"{tick.flops:>6}", f"{1e6 * tick.floats:10.0f}", f"{1e6 * tick.arrays:10.0f}", f"{1e6 * tick.called:8.2f}",
            f"{1e9 * tick.native:10.0f}", f"{1e9 * tick.lanes:9.1f}", f"{tick.floats / tick.called:12.0f}",
            f"{tick.floats / tick.native:14.0f}",
        )  # fmt: skip
        print(f"{name:48s}", *numbers, flush=True)
    return 0


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 11))
