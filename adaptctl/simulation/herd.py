"""Arms that take a stretch of time together, so that what they read and write fits the caches."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, numbers, whole_count
from adaptctl.compilation import Stepper
from adaptctl.compilation.stepper import Source
from adaptctl.control.adaptation.law import AdaptationLaw
from adaptctl.control.controller import Controller
from adaptctl.dynamics.loops.single_precision import require_single_precision
from adaptctl.errors import InputError
from adaptctl.scalars import Tunable
from adaptctl.simulation.closed_loop import ClosedLoop
from adaptctl.simulation.references import ReferencesOfMany
from adaptctl.simulation.summaries import first_rise, watched

Seeds: TypeAlias = int | Sequence[int] | NDArray[np.object_] | None
"""One seed for all arms, one for each, or None for another noise each time."""


def checked_seeds(given: object) -> Seeds:
    """The seeds `given` of many arms' noise: None, a whole number of at least 0, or, made of a list or array of such
    numbers, an array of them of the same shape. Raises `InputError` for all else, such as 2.0, texts and booleans."""
    if given is None:
        return None
    each = np.asarray(given, dtype=np.object_)
    for seed in each.flat:
        whole_count(seed, "seed")
    return each if each.ndim else int(each[()])


@dataclass(frozen=True, eq=False)
class Noise:
    """Source of sensor noise for M arms: independent standard normal numbers, without a unit, `size` of them for each
    arm in a control period. `generators` has one random generator for all arms, or one for each; `members` is M.
    Nothing is checked."""

    generators: Sequence[np.random.Generator]
    members: int
    size: int

    @classmethod
    def of(cls, seed: Seeds, members: int, herd: int, size: int) -> list[Noise]:
        """Sources of sensor noise for `members` arms, a list with one `Noise` for each group of at most `herd` arms, in
        the arms' order; an arm takes `size` numbers in a control period. `seed` is one whole number for all arms, None
        for another noise each time, or a sequence of one for each arm, whose noise then does not depend on the other
        arms; the same seeds give the same noise. Raises `ValueError` for a seed below 0 and, where `size` is not 0, for
        a sequence of another length, but for length 1, which gives every arm the same noise."""
        counts = [min(herd, members - first) for first in range(0, members, herd)]
        if seed is None or isinstance(seed, int | np.integer):
            root = np.random.SeedSequence(None if seed is None else int(seed))
            sources = [root, *root.spawn(len(counts) - 1)]
            return [cls([np.random.default_rng(x)], n, size) for x, n in zip(sources, counts, strict=True)]
        each = [np.random.default_rng(int(x)) for x in np.broadcast_to(np.asarray(seed), (members,))] if size else []
        return [cls(each[k * herd : k * herd + n], n, size) for k, n in enumerate(counts)]

    def drawn(self, steps: int) -> Array:
        """Standard normal numbers (steps, M, size), without a unit, of the next `steps` control periods of M arms,
        `size` for each arm in a period. Each call draws new ones, the same sequence for the same seeds. Raises
        `ValueError` for `steps` below 0."""
        if self.size == 0:
            return np.zeros((steps, self.members, 0))
        if len(self.generators) == 1:
            return self.generators[0].standard_normal((steps, self.members, self.size))
        return np.stack([rng.standard_normal((steps, self.size)) for rng in self.generators], axis=1)


@dataclass(frozen=True, eq=False)
class GainsOfMany:
    """Gains (tunable numbers) of M arms' controllers, which differ in nothing else. `controller` stands for all of
    them; `given` maps names in `controller.numbers`, such as "bandwidth", to arrays in the shapes and units that they
    have there, the same for all arms, or with a leading axis of M. Numbers not given are those of the `controller`.
    `GainsOfMany.of` checks them; the class itself checks nothing."""

    controller: Controller[Any]
    given: Mapping[str, Array]

    @classmethod
    def of(cls, controller: Controller[Any] | Sequence[Controller[Any]], given: Mapping[str, ArrayLike]) -> GainsOfMany:
        """The gains of M controllers in a sequence, which differ in their numbers alone; or of one `controller` with
        the numbers that are `given` by name, for all arms or with a row for each, which its constructor checks.

        Raises `InputError` for an empty sequence, for what is no `Controller`, for controllers that differ in more or
        come with gains, and for arrays of another shape or of no numbers, `NotFoundError` for an unknown name, and what
        the controller's class raises for its numbers, such as `GainError`."""
        one = controller if isinstance(controller, Controller) else _first_of(controller)
        if isinstance(controller, Sequence) and one.numbers:
            if given:
                raise InputError("gains: expected none besides those of a sequence of controllers")
            return cls(one, {name: np.stack([law.numbers[name] for law in controller]) for name in one.numbers})
        one.tuned({name: one.numbers.get(name, values) for name, values in given.items()})
        gains = cls(one, {name: numbers(values, name) for name, values in given.items()})
        for name, values in gains.given.items():
            shape = one.numbers[name].shape
            if values.shape not in (shape, (*values.shape[:1], *shape)):
                raise InputError(f"gains: {name}: expected shape {shape}, or {('M', *shape)}, got {values.shape}")
        gains.require()
        return gains

    @property
    def arms(self) -> dict[str, tuple[int, ...]]:
        """The leading axes of each gain given, by its name with the word "gains" before it, as in "gains bandwidth".
        They are (M,) where the gain has a row for each of M arms, () where it is the same for all; the mapping is empty
        where no gain is given."""
        sizes = {name: x.ndim - self.controller.numbers[name].ndim for name, x in self.given.items()}
        return {f"gains {name}": self.given[name].shape[:axes] for name, axes in sizes.items()}

    def require(self) -> None:
        """Raise what the controller's class raises for its numbers, such as `InputError` and `GainError`, unless each
        arm's set of gains would make a controller. Gains with unlike numbers of rows are not checked; `simulate_many`
        refuses them."""
        if not self.given:
            return
        count = max((axes[0] for axes in self.arms.values() if axes), default=1)
        if any(axes not in ((), (count,)) for axes in self.arms.values()):
            return  # refused with all that has a row each
        each = self._rows(slice(0, count), count)
        self._try_largest(each)
        rows = np.concatenate([x.reshape(count, -1) for x in each.values()], axis=1)
        for k in np.unique(rows, axis=0, return_index=True)[1].tolist():
            self.controller.tuned({name: x[k] for name, x in each.items()})

    def _try_largest(self, each: Mapping[str, Array]) -> None:
        """Try the largest of every number together: where they are accepted, so is what needs less, without a search
        for each set (`require_hold`)."""
        with suppress(InputError):
            self.controller.tuned({name: x.max(axis=0) for name, x in each.items()})

    def of_arms(self, arms: slice) -> dict[str, Array]:
        """All tunable numbers of the controllers of M arms, by their names in `Controller.numbers`: arrays (M, ...) in
        the shapes and units that they have there. The slice `arms`, with a start and a stop, selects the M arms. The
        dict is empty where no gain is given. Nothing is checked."""
        if not self.given:
            return {}
        count = arms.stop - arms.start
        own = {name: np.broadcast_to(x, (count, *x.shape)) for name, x in self.controller.numbers.items()}
        return own | self._rows(arms, count)

    def packed(self, arms: slice) -> Array:
        """All g tunable numbers of the controllers of M arms in one array (M, g), in the order of `Controller.numbers`,
        matrices row by row. The slice `arms`, with a start and a stop, selects the M arms. Raises `ValueError` where no
        gain is given."""
        return np.concatenate([x.reshape(len(x), -1) for x in self.of_arms(arms).values()], axis=1)

    def _rows(self, arms: slice, count: int) -> dict[str, Array]:
        rows = {name: x[arms] if self.arms[f"gains {name}"] else x for name, x in self.given.items()}
        return {name: np.broadcast_to(x, (count, *self.controller.numbers[name].shape)) for name, x in rows.items()}


def _first_of(given: object) -> Controller[Any]:
    """The first of a sequence of controllers that differ in numbers alone."""
    laws = list(given) if isinstance(given, Sequence) else []
    if not laws or not all(isinstance(one, Controller) for one in laws):
        raise InputError(f"controller: expected a Controller or a sequence of them, got {given!r}")
    for k, one in enumerate(laws):
        if one.structure != laws[0].structure:
            raise InputError(f"controller: expected any to differ in numbers alone, number {k} does not")
    return laws[0]


LONGEST = 2**24
"""Control periods that single precision can count."""


def require_single(loop: ClosedLoop, steps: int) -> None:
    """Raise `InputError` unless a closed loop can be simulated in single precision (float32) for so many `steps`,
    control periods. It cannot where that leaves the mechanism's kinematic loops open by more than 1e-5 m or rad; with
    an adaptation law whose internal state is a k x k matrix for k parameters, as its small eigenvalues would be lost;
    and for more than 2^24 periods, the most that it counts. Raises `LoopError`, a subclass of it, where loops cannot be
    closed."""
    require_single_precision(loop.plant.mechanism, "precision")
    for part in _parts(loop.controller):
        if isinstance(part, AdaptationLaw) and part.needs_double:
            kind = type(part).__name__
            raise InputError(f"precision: single precision loses the matrix in which {kind} forgets: use double")
    if steps > LONGEST:
        raise InputError(f"precision: single precision counts to {LONGEST} control periods, got {steps}: use double")


def _parts(law: Tunable) -> Iterator[Tunable]:
    """A law, and the laws that it is made of."""
    yield law
    for part in law.tunable_parts.values():
        yield from _parts(part)


MEMORY = 2**23
"""Bytes that a native call may read and write besides the arms' states."""
STRETCH = 2000
"""Control periods in one native call, at most: in between progress is reported, and Ctrl-C handled."""


class Herd:
    """A group of M arms, copies of one closed loop, that native code moves together through a stretch of control
    periods, so that what it reads and writes fits the processor's caches.

    `loop` is the closed loop, and `stepper` its native step of one control period; `members` is the slice of these arms
    among all that are simulated, and `references` and `noise` are for these arms alone. `parameters` (M, P) are their P
    true inertial and friction parameters, SI units, in the order of `Mechanism.parameter_names`, without the loads of
    effects. The attribute `arms` is the `Ensemble` of M copies of the step, all zero until `begin`. Raises `InputError`
    where `parameters` has no rows.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        stepper: Stepper,
        references: ReferencesOfMany,
        parameters: Array,
        noise: Noise,
        members: slice,
    ) -> None:
        self.loop, self.references, self.parameters = loop, references, parameters
        self.noise, self.members = noise, members
        self.arms = stepper.ensemble(len(parameters))

    def begin(
        self, p: Array, v: Array, memory: Any, tuned: GainsOfMany, bounds: Mapping[str, Array], final: int
    ) -> None:
        """Put the M arms of this group, of r joints each, at time zero, at positions `p`, rad (m if prismatic), and
        velocities `v`, rad/s (m/s), (M, r) each. `memory` is the controllers' initial internal state: arrays (M,
        length), or (length,) for all arms alike; None for that of new controllers at the first measurement, whose noise
        is drawn here. `tuned` has the gains of all arms simulated, of which this group takes its own. `bounds` are
        arrays (r,), rad (m), by the names "within", to which errors are to return, and "beyond", past which a run has
        diverged (infinity becomes the largest number of the precision); `final` is the index of the control period from
        which on errors count as final.

        Raises `SingularityError` where loops cannot be followed to p, `InputError` on a wrong shape, `NonFiniteError`
        on NaN or infinity.
        """
        loop, own, largest = self.loop, tuned.of_arms(self.members), float(np.finfo(self.arms.stepper.dtype).max)
        state = loop.plant.init(p, v, loop.plant.parameters(self.parameters, 0.0), self.noise.drawn(1)[0])
        begun = loop.controller.init(state.measured_p, state.measured_v, own) if memory is None else memory
        loop.begin(self.arms, state, begun)
        rise, true = first_rise(watched(loop, self.arms.stepper.precision), self.parameters, own)
        held: dict[str, Any] = {"parameters": self.parameters, **self.references.held, "final": float(final), **true}
        held |= {name: np.minimum(bound, largest) for name, bound in bounds.items()}
        held |= dict.fromkeys(loop.controller.gain_sizes, tuned.packed(self.members)) if own else {}
        for columns, values in ((self.arms.state, rise), (self.arms.held, held)):
            for name, each in values.items():
                columns[name] = each

    def longest(self, *, record: bool) -> int:
        """The number of control periods that one native call of this group takes at most, from 1 to STRETCH (2000): as
        many as keep what it reads and writes, besides the arms' states, within MEMORY (2^23 bytes). With `record` the
        samples of all periods count too. Nothing is raised."""
        shapes, columns = self.arms.stepper.outputs, self.arms.stepper.columns
        numbers = sum(columns[Source.DRIVEN].values()) + (sum(map(math.prod, shapes)) if record else 0)
        return max(1, min(STRETCH, MEMORY // (8 * self.arms.members * numbers) if numbers else STRETCH))

    def taken(self, time: Array, *, record: bool, threads: int) -> tuple[Array, ...]:
        """Run this group's M arms through the T control periods that begin at the times `time` (T,), s, and return the
        outputs of the native step, what its equation returns after the new state. They are an array for each output, in
        the equation's order: (T, M, length) of all periods with `record`, else (M, length) of the last one.

        The loads of effects are those at the first of these times. `threads` is the number of threads to which the arms
        are distributed. Raises `InputError` for a number of threads below 1, and what the references raise,
        `InputError` and `NonFiniteError`, where they are sampled.
        """
        if self.loop.plant.loads:
            self.arms.held["parameters"] = self.loop.plant.parameters(self.parameters, time[0])
        signals = {**self.references.signals(time), "noise": self.noise.drawn(len(time))}
        return self.arms.run(len(time), signals, record=record, threads=threads)
