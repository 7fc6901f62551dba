"""Many arms in their tracking environments: their state in one array of lanes, their steps in native code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, frozen
from adaptctl.caching import State, cached_property, restored, without_caches
from adaptctl.compilation import Ensemble, Kernel, Stepper, compile_function, compile_step
from adaptctl.compilation.lanes import Precision, require_precision
from adaptctl.dynamics.loops.single_precision import require_single_precision
from adaptctl.envs.many.episodes import ArmOptions, ArmReferences, ArmStreams
from adaptctl.envs.random_reference import Trajectory, all_drawn
from adaptctl.envs.task import Judgement
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.errors import NonFiniteError
from adaptctl.scalars import Column, Scalar, where
from adaptctl.simulation.plant import Plant, require_ten_a_link
from adaptctl.simulation.references import SinusoidForm

LARGEST = 1e300
"""Squares summed below which a motion has not run away."""


class Facts(NamedTuple):
    """Named tuple of what one control period of one arm gives besides its state and observation, a scalar each (float,
    array over arms, or symbol to be compiled); conditions are 1.0 for true, 0.0 for false. `finite` asks that the
    squares of all joint positions and velocities sum to less than 1e300; `sure`, that a lower bound proves loops away
    from singularities and positions within the file's conditions, 0 where one has to look. Nothing is checked.
    """

    reward: Any
    """without what ending costs"""
    finite: Any
    lost: Any
    """a position error passed its bound"""
    sure: Any
    energy: Any
    """kinetic plus potential, J, with the parameters of the period that ends"""
    clipped: Any
    """the torque was clipped to its limits"""


@dataclass(frozen=True, eq=False)
class VectorStep:
    """One control period of a tracking environment, for one arm or many, as an equation over scalars of any kind
    (floats, arrays, or symbols) that is to be compiled: the motion of the plant under a held torque, the observation
    and the reward, each arm at a time (s) of its own.

    `plant` is the `Plant`, of r joints; `look_ahead` (L,) are the times ahead, s, at which the reference is observed;
    `judgement`, a `Judgement`, has the equation of the reward and the bounds on errors that end an episode;
    `sinusoids`, a `SinusoidForm`, states how many sinusoids a reference sums in each joint, which the step evaluates
    from each arm's numbers. If that is 0, the reference is an input, a row of samples: positions, velocities and
    accelerations now, then the positions at each time ahead. Nothing is checked.
    """

    plant: Plant
    look_ahead: Array
    judgement: Judgement
    sinusoids: SinusoidForm

    @property
    def reference(self) -> dict[str, int]:
        """Lengths, by name, of the input columns (vectors) that define an arm's reference. Where references are sampled
        there is one, {"row": 3r + r L}, for r joints and L look-ahead times; else there are "time" (1) and the
        parameters of h sinusoids a joint: "center" (r), "amplitude", "frequency" and "phase" (r h each, with the r
        numbers of the first sinusoid first) and "start_time" (1)."""
        if not self.sinusoids.terms:
            return {"row": (3 + len(self.look_ahead)) * self.plant.dof}
        return self.sinusoids.shared | self.sinusoids.held

    @property
    def held(self) -> dict[str, int]:
        """Lengths, by name, of the input columns (vectors) that a step reads and does not change: "torque" (r), "noise"
        (2r, the positions' first, or 0 without sensors), "parameters" (P, the true inertial and friction ones, in the
        order of `Mechanism.parameter_names`) and those of the property `reference`, for r joints."""
        given = {"torque": self.plant.dof, "noise": self.plant.noise_size}
        return given | {"parameters": self.plant.mechanism.equations.parameters} | self.reference

    def compile(self, precision: Precision = "double") -> Stepper:
        """Native code of the step, a `Stepper`, whose state are the plant's columns, named in `Plant.sizes`, and which
        holds those of the property `held`. Raises `InputError` for a `precision` other than "double" and "single"."""
        sizes = self.plant.sizes
        return compile_step(self.equation, state=sizes, held=self.held, name="vector_step", precision=precision)

    def compile_row(self) -> Kernel:
        """Native code, a `Kernel`, of `row`, with an array for each column of the property `reference`, in that order.
        Nothing is raised."""

        def row(**reference: Column) -> Column:
            return self.row(reference)

        return compile_function(row, self.reference, name="row")

    def row(self, columns: Mapping[str, Column]) -> Column:
        """Reference's positions, velocities and accelerations now and positions ahead, a `Column` (vector of scalars of
        any kind) of length 3r + r L: those of r joints at one time, then the positions at each of L look-ahead times
        after it, in rad, rad/s, rad/s^2 (m, m/s, m/s^2 if prismatic). `columns` maps names to Columns and has those
        whose lengths are in the property `reference`: "row", which is returned as it is, for a sampled reference, else
        "time", s, and the sinusoids' parameters. Raises `KeyError` for one that is missing."""
        if not self.sinusoids.terms:
            return columns["row"]
        now, *ahead = (self.sinusoids.point(columns, delay) for delay in (0.0, *self.look_ahead.tolist()))
        return Column(x for part in (*now, *(point.p for point in ahead)) for x in part)

    def equation(self, **columns: Column) -> tuple[Column, ...]:
        """Results of one control period over Columns (vectors of scalars of any kind), SI units. The first four are the
        plant's new state, in the order of `Plant.sizes`. The fifth is the observation (5r + r L,): measured positions
        and velocities, then the reference's row. The sixth has the six numbers of `Facts` and the plant's flags of
        actuator effects. The seventh (3r,) has the true positions, the velocities and the torques applied.

        `columns` are, by name, the state before the control period and those of the property `held`. Raises `KeyError`
        for one that is missing.
        """
        plant, row = self.plant, self.row(columns)
        after = plant.equation(columns)
        p = plant.primary(after.q)
        wanted_p, wanted_v = (Column(row.of[k * plant.dof : (k + 1) * plant.dof]) for k in range(2))
        judged = self.judgement.equation(p, after.v, wanted_p, wanted_v, after.applied)
        facts = Facts(
            judged.reward,
            where(after.q @ after.q + after.v @ after.v < LARGEST, 1.0, 0.0),
            judged.lost,
            self._surely_works(after.q, p),
            plant.energy_equation(after.q, after.v, columns["parameters"], after.drives),
            after.clipped[0],
        )
        observation = Column((*after.measured_p, *after.measured_v, *row))
        return *after[:4], observation, Column((*facts, *after.marks)), Column((*p, *after.v, *after.applied))

    def _surely_works(self, q: Column, p: Column) -> Scalar:
        """1 where loops are surely away from singularities and within their conditions, else 0."""
        mechanism = self.plant.mechanism
        if mechanism.continuation is None:
            return 1.0
        sure = mechanism.continuation.surely_regular(q)
        description = mechanism.description
        joints = [description.joint_names[i] for i in description.primary]
        for condition in description.loops.conditions if description.loops else ():
            total = Column(condition.weights.get(name, 0.0) for name in joints) @ p
            sure = where(total > condition.lower, where(total < condition.upper, sure, 0.0), 0.0)
        return sure


Numbers = NDArray[np.int64]
"""Indices (k,) of some of N arms."""
Flags = NDArray[np.bool_]


@dataclass(slots=True)
class StepResult:
    """Results of a control period, or of the beginning of an episode, of k arms of r joints, as arrays with a row for
    each arm.

    `observation` (k, n), n numbers an arm, in the environment's units; `reward` (k,), unitless; `terminated` and
    `truncated` (k,), bools, the two ways in which an episode ends; `time` (k,), s since the reset; `energy` (k,),
    kinetic plus potential, J; `clipped` (k,), the number of control periods since the reset in which a torque was
    clipped; `p` and `v` (k, r), the true positions, rad (m if prismatic), and velocities, rad/s (m/s), not those
    measured; `torque` (k, r), N m (N), as applied at the joints; `marks` (k, h), flags of the h actuator effects named
    in `Plant.marks`, 1 where the effect changed a torque, else 0. Nothing is checked.
    """

    observation: Array
    reward: Array
    terminated: Flags
    truncated: Flags
    time: Array
    energy: Array
    clipped: Numbers
    p: Array
    v: Array
    torque: Array
    marks: Array

    def copy(self) -> StepResult:
        """Copy of this object, a new `StepResult` whose arrays are copies."""
        return StepResult(*(getattr(self, field.name).copy() for field in fields(self)))

    def put(self, arms: Numbers, others: StepResult) -> None:
        """Replace the rows of the arms of indices `arms` (k,), zero-based, by the k rows of `others`, in place."""
        for field in fields(self):
            getattr(self, field.name)[arms] = getattr(others, field.name)


class Arms:
    """State of N arms, each as in a `TrackingEnv` with the settings of `single`: the method `advance` takes a control
    period of all arms together in native code, the method `begin` starts new episodes of some.

    `count` is N; `precision`, "double" by default or "single", is that of the native code. Attributes: `steps` and
    `clipped` (N,), the numbers of control periods since the reset and of those with a clipped torque; `parameters` (N,
    P), the P true inertial and friction parameters now, payloads included, SI units, in the order of
    `Mechanism.parameter_names`, read-only; `payload` (N,), the mass in kg that load effects add. Raises `InputError`
    for another precision, and where single precision cannot close the mechanism's loops.
    """

    def __init__(self, single: TrackingEnv, count: int, precision: Precision = "double") -> None:
        self.single, self.count, self.precision = single, count, precision
        require_precision(precision)
        if precision == "single":
            require_single_precision(single.mechanism, "precision")
        r = self._dof = single.plant.dof
        self._loops = single.mechanism.continuation is not None
        self.all = np.arange(count)
        self.steps, self.clipped = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        self.references = ArmReferences(count, r, single.control_period, single.look_ahead)
        self.streams = ArmStreams(count, single.plant.noise_size)
        self._own = np.tile(single.mechanism.inertial_parameters, (count, 1))
        self.parameters = frozen(self._own.copy())
        """(N, P) true inertial parameters now, payloads included; read-only"""
        self.payload, self._until = np.zeros(count), np.full(count, np.inf)
        self._terms: int | None = None
        self._ensembles: dict[int, Ensemble] = {}
        self._kernels: dict[int, Kernel] = {}

    def begin(self, arms: Numbers, options: Mapping[str, Any]) -> StepResult:
        """First results, a `StepResult` of k rows, of new episodes of the k arms of zero-based indices `arms`, which
        this call begins. `options` are those of `TrackingEnv.reset`, one value for all N arms or N of them; others are
        ignored, and what is missing is that of the single environment. Raises `InputError`, naming the arm, for a bad
        value (its subclass `NonFiniteError` for one that is not finite), `SingularityError` where loops cannot be
        followed to the start."""
        single, chosen, r = self.single, ArmOptions(self.count, arms), self._dof
        error = chosen.numbers(options.get("initial_error", single.initial_error), r, "initial_error")
        own, last = single.mechanism.inertial_parameters, len(single.mechanism.description.bodies) - 1
        if "payload" in options:
            require_ten_a_link(single.mechanism)
        self._own[arms] = chosen.parameters(options, own, last)
        self._follow(arms, chosen.each(options.get("trajectory", single.trajectory), "trajectory"))
        self.steps[arms], self.clipped[arms] = 0, 0
        parameters, row = self._load(arms), self._row(arms)
        noise = self.streams.normal(arms)
        state = single.plant.init(row[:, :r] + error, row[:, r : 2 * r], parameters, noise)
        q, p, v = state.q, state.p, state.v
        for name, values in zip(single.plant.sizes, (q, v, state.drives, state.sensors), strict=True):
            self._lanes.state.put(name, arms, values)
        observation = np.concatenate((state.measured_p, state.measured_v, row), axis=1)
        energy = self._energy.map(q, v, parameters, state.drives)
        never, zero, torque = np.zeros(len(arms), dtype=np.bool_), np.zeros(len(arms)), np.zeros_like(v)
        return StepResult(observation, zero, never, never, zero, energy, self.clipped[arms], p, v, torque, state.marks)

    def advance(self, torque: Array, moving: Numbers) -> StepResult:
        """Results, a `StepResult` of N rows, of one control period, by which this call advances all N arms under the
        torques `torque` (N, r) of r joints each, N m (N if prismatic), clipped to the torque limits and held. `moving`
        are the indices, zero-based, of the arms whose rows count; rows of other arms are arbitrary. Raises `InputError`
        for torques that do not broadcast to (N, r), `NonFiniteError`, naming the arm and the time, where the motion of
        a moving arm diverges: its positions and velocities are not finite, or their squares sum to 1e300 or more.
        Torques are not checked for NaN."""
        self.steps += 1
        time = np.asarray(self.single.control_period * self.steps, dtype=np.float64)
        self._give(torque, time, moving)
        observation, numbers, true = self._lanes.run()
        facts, marks = Facts(*np.ascontiguousarray(numbers.T)[: len(Facts._fields)]), numbers[:, len(Facts._fields) :]
        self._require_finite(facts.finite, moving)
        self.clipped += facts.clipped > 0.0
        p, v, applied = (true[:, k * self._dof : (k + 1) * self._dof] for k in range(3))
        terminated = self._terminated(facts)
        reward = np.asarray(facts.reward - self.single.reward_weights.termination * terminated, dtype=np.float64)
        judged = reward, terminated, self.steps >= self.single.steps
        result = StepResult(observation, *judged, time, facts.energy, self.clipped.copy(), p, v, applied, marks)
        self._reload(result)
        return result

    def _give(self, torque: Array, time: Array, moving: Numbers) -> None:
        """Set the inputs of a step to a time (N,): torque, noise, and the reference's time or row."""
        held, noise_size = self._lanes.held, self.single.plant.noise_size
        held["torque"] = torque
        if noise_size:
            noise = np.zeros((self.count, noise_size))
            noise[moving] = self.streams.normal(moving)
            held["noise"] = noise
        if self._terms:
            held["time"] = time[:, None]
        else:
            held["row"] = self.references.rows(self.all, self.steps)

    @property
    def rows(self) -> Array:
        """Values (N, 3r + r L) of the references of all N arms now, as `VectorStep.row` has them. Raises
        `NotFoundError`, naming an arm, before all arms have begun an episode."""
        return self._row(self.all)

    @property
    def positions(self) -> Array:
        """True positions (N, r) of the r primary (independent) joints of all N arms now, rad (m if prismatic). Raises
        `KeyError` before an arm has begun an episode."""
        return self.single.plant.positions(self._lanes.state["q"])

    def _follow(self, arms: Numbers, trajectories: Sequence[Trajectory]) -> None:
        """Give some arms references, and native code their numbers."""
        references = all_drawn(trajectories, self.single.mechanism, lambda k: self.streams.generator(int(arms[k])))
        self.references.put(arms, references)
        needed = self.references.terms
        terms = max(needed, self._terms or 0) if needed else 0
        if terms != self._terms:
            self._change_code(terms)
            arms = self.all
        if terms:
            for name, values in self.references.numbers(arms, terms)._asdict().items():
                self._lanes.held.put(name, arms, values)

    def _change_code(self, terms: int) -> None:
        """Go on with a step that evaluates so many sinusoids a joint, or none."""
        before = self._lanes if self._terms is not None else None
        self._terms = terms
        if terms not in self._ensembles:
            self._ensembles[terms] = self._step.compile(self.precision).ensemble(self.count)
        if before is not None:
            for name in before.state.columns:
                self._lanes.state[name] = before.state[name]
            self._lanes.held["parameters"] = self.parameters

    @property
    def _lanes(self) -> Ensemble:
        return self._ensembles[self._terms or 0]

    def __getstate__(self) -> tuple[State, dict[int, list[dict[str, Array]]]]:
        """State of the arms for copies in other processes, native code left out, and their columns."""
        kept, read_only = without_caches(self)
        columns = {
            terms: [{name: part[name].copy() for name in part.columns} for part in (arms.state, arms.held)]
            for terms, arms in self._ensembles.items()
        }
        return (kept | {"_ensembles": {}, "_kernels": {}}, read_only), columns

    def __setstate__(self, given: tuple[State, dict[int, list[dict[str, Array]]]]) -> None:
        state, columns = given
        restored(self, state)
        for terms, parts in columns.items():
            self._terms = terms
            arms = self._ensembles[terms] = self._step.compile(self.precision).ensemble(self.count)
            for part, values in zip((arms.state, arms.held), parts, strict=True):
                for name, column in values.items():
                    part[name] = column
        self._terms = state[0]["_terms"]

    @property
    def _step(self) -> VectorStep:
        single, form = self.single, SinusoidForm(self._dof, self._terms or 0)
        return VectorStep(single.plant, single.look_ahead, single.judgement, form)

    def _row(self, arms: Numbers) -> Array:
        """The reference's rows of some arms now."""
        if not self._terms:
            return self.references.rows(arms, self.steps[arms])
        if self._terms not in self._kernels:
            self._kernels[self._terms] = self._step.compile_row()
        time = self.single.control_period * self.steps[arms, None]
        return np.asarray(self._kernels[self._terms].map(time, *self.references.numbers(arms, self._terms)))

    def _load(self, arms: Numbers) -> Array:
        """The true parameters (k, P) of some arms now, with what they hold; others' stay."""
        plant, rows = self.single.plant, self._own[arms]
        times = self.single.control_period * self.steps[arms]
        for time in np.unique(times).tolist() if plant.loads else ():
            now = times == time
            rows[now] = plant.parameters(rows[now], time)
            self.payload[arms[now]], self._until[arms[now]] = plant.payload(time), plant.until(time)
        parameters = self.parameters.copy()
        parameters[arms] = rows
        self.parameters = frozen(parameters)
        self._lanes.held.put("parameters", arms, rows)
        return rows

    def _reload(self, result: StepResult) -> None:
        """Pick up and drop what is due, which counts in the energy already."""
        due = np.flatnonzero(result.time >= self._until)
        if due.size:
            result.energy[due] = self._energy.map(
                self._lanes.state["q"][due], result.v[due], self._load(due), self._lanes.state["drives"][due]
            )

    def _terminated(self, facts: Facts) -> Flags:
        """Mask of the arms that are lost, or whose loops are where they may not work; those in doubt are computed
        exactly."""
        terminated: Flags = facts.lost > 0.0
        doubtful = np.flatnonzero(facts.sure < 1.0) if self._loops else self.all[:0]
        if doubtful.size:
            terminated[doubtful] |= ~self.single.plant.may_work(self._lanes.state["q"][doubtful])
        return terminated

    def _require_finite(self, finite: Array, moving: Numbers) -> None:
        lost = moving[finite[moving] < 1.0] if not finite.all() else moving[:0]
        if lost.size:
            time = self.single.control_period * self.steps[lost[0]]
            raise NonFiniteError(
                f"{self.single.mechanism.name}: the motion of arm {lost[0]} ran away after {time:g} s: use a shorter "
                "control period or more substeps, weaker actions, a bound on errors that ends episodes earlier, and "
                "parameters whose mass matrix is positive definite"
            )

    @cached_property
    def _energy(self) -> Kernel:
        equations = self.single.mechanism.equations
        sizes = {"q": equations.joints, "v": equations.dof, "parameters": equations.parameters}
        sizes["drives"] = self.single.plant.sizes["drives"]
        return compile_function(self.single.plant.energy_equation, sizes, name="energy")
