"""State and steps of many arms in native code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, frozen
from adaptctl.caching import State, cached_property, restored, without_caches
from adaptctl.compilation import Ensemble, Kernel, Stepper, compile_function, compile_step
from adaptctl.compilation.lanes import Precision, validate_precision
from adaptctl.control.controller import Reference
from adaptctl.control.references import SinusoidNumbers, Sinusoids
from adaptctl.dynamics.loops.single_precision import validate_single_precision
from adaptctl.envs.many.episodes import ArmOptions, ArmStreams
from adaptctl.envs.random_reference import Trajectory, all_drawn
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column, Scalar, where
from adaptctl.simulation.plant import validate_ten_a_link
from adaptctl.simulation.references import Preview, ReferenceForm

MAX_SQUARED_SUM = 1e300
"""Bound of squared sums, above which a motion diverges."""
PREVIEW_BLOCK = 64
"""Control periods sampled at once."""

Numbers = NDArray[np.int64]
"""Indices (k,) of arms."""
Flags = NDArray[np.bool_]
Told = dict[str, Any]
"""Results of k arms: "observation" (k, n); "time" in s, "energy" in J, "reward", "terminated", "truncated", "clipped"
(k,); true "p" and "v", applied "torque" in N m (N) (k, r); "flags" (k, h).
"""


def put(told: Told, arms: Numbers, others: Told) -> None:
    """Replace the rows of some arms in place."""
    for name, values in told.items():
        values[arms] = others[name]


class Facts(NamedTuple):
    """Scalars of one control period of one arm."""

    reward: Any
    """without the penalty of termination"""
    finite: Any
    lost: Any
    sure: Any
    energy: Any
    """kinetic plus potential, J, before a payload changes"""
    clipped: Any


class Arms:
    """State of N arms that step together."""

    def __init__(self, single: TrackingEnv, count: int, precision: Precision = "double") -> None:
        self.single, self.count, self.precision = single, count, precision
        validate_precision(precision)
        if precision == "single":
            validate_single_precision(single.mechanism, "precision")
        self._dof, self._loops = single.plant.dof, single.mechanism.continuation is not None
        self.all = np.arange(count)
        self.steps, self.clipped = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        self.streams = ArmStreams(count, single.plant.noise_size)
        self._own = np.tile(single.mechanism.inertial_parameters, (count, 1))
        self.parameters = frozen(self._own.copy())
        self.payload, self._until = np.zeros(count), np.full(count, np.inf)
        self._references: list[Reference | None] = [None] * count
        self._waves, self._terms = np.zeros(count, dtype=np.int64), 0
        self._previews: list[Preview] = []
        self._places = np.full(count, -1)
        self._steppers: dict[int, Stepper] = {}
        self._kernels: dict[int, Kernel] = {}
        self._lanes: Any = None  # an `Ensemble`, once there are references

    def begin(self, arms: Numbers, options: Mapping[str, Any]) -> Told:
        """First results of new episodes."""
        single, chosen, r = self.single, ArmOptions(self.count, arms), self._dof
        error = chosen.numbers(options.get("initial_error", single.initial_error), r, "initial_error")
        own, last = single.mechanism.inertial_parameters, len(single.mechanism.description.bodies) - 1
        if "payload" in options:
            validate_ten_a_link(single.mechanism)
        self._own[arms] = chosen.parameters(options, own, last)
        self._follow(arms, chosen.each(options.get("trajectory", single.trajectory), "trajectory"))
        self.steps[arms], self.clipped[arms] = 0, 0
        parameters, row = self._load(arms), self.rows(arms)
        state = single.plant.init(row[:, :r] + error, row[:, r : 2 * r], parameters, self.streams.normal(arms))
        for name, values in zip(single.plant.sizes, (state.q, state.v, state.drives, state.sensors), strict=True):
            self._lanes.state.put(name, arms, values)
        return {
            "observation": np.concatenate((state.measured_p, state.measured_v, row), axis=1),
            "reward": np.zeros(len(arms)),
            "terminated": np.zeros(len(arms), dtype=np.bool_),
            "truncated": np.zeros(len(arms), dtype=np.bool_),
            "time": np.zeros(len(arms)),
            "energy": self._energy.map(state.q, state.v, parameters, state.drives),
            "clipped": self.clipped[arms],
            "p": state.p,
            "v": state.v,
            "torque": np.zeros_like(state.v),
            "flags": state.flags,
        }

    def advance(self, torque: Array, moving: Numbers) -> Told:
        """Results of one control period under torques (N, r)."""
        self.steps += 1
        held, time = self._lanes.held, self.single.control_period * self.steps
        held["torque"] = torque
        if size := self.single.plant.noise_size:
            noise = np.zeros((self.count, size))
            noise[moving] = self.streams.normal(moving)
            held["noise"] = noise
        if self._terms:
            held["time"] = time[:, None]
        else:
            held["row"] = self.rows(self.all)
        observation, numbers, true = self._lanes.run()
        facts, flags = Facts(*np.ascontiguousarray(numbers.T)[: len(Facts._fields)]), numbers[:, len(Facts._fields) :]
        self._validate_finite(facts.finite, moving)
        self.clipped += facts.clipped > 0.0
        terminated = self._terminated(facts)
        told: Told = {
            "observation": observation,
            "reward": facts.reward - self.single.reward_weights.termination * terminated,
            "terminated": terminated,
            "truncated": self.steps >= self.single.steps,
            "time": time,
            "energy": facts.energy,
            "clipped": self.clipped.copy(),
        }
        told |= zip(("p", "v", "torque"), (true[:, k * self._dof : (k + 1) * self._dof] for k in range(3)), strict=True)
        self._reload(told)
        return told | {"flags": flags}

    @property
    def positions(self) -> Array:
        """True positions (N, r)."""
        return self.single.plant.positions(self._lanes.state["q"])

    def rows(self, arms: Numbers) -> Array:
        """Reference rows (k, 3r + r L)."""
        steps = self.steps[arms]
        if self._terms:
            if self._terms not in self._kernels:
                self._kernels[self._terms] = compile_function(self._row, self._reference, name="row")
            time = self.single.control_period * steps[:, None]
            return np.asarray(self._kernels[self._terms].map(time, *self._sines(arms)))
        rows, places = np.empty((len(arms), sum(self._reference.values()))), self._places[arms]
        for place in np.unique(places).tolist():
            rows[places == place] = self._previews[place].rows(steps[places == place])
        return rows

    def _sines(self, arms: Numbers) -> SinusoidNumbers:
        return self._form.numbers([self._references[arm] for arm in arms.tolist()])

    def _follow(self, arms: Numbers, trajectories: Sequence[Trajectory]) -> None:
        references = all_drawn(trajectories, self.single.mechanism, lambda k: self.streams.generator(int(arms[k])))
        for arm, one in zip(arms.tolist(), references, strict=True):
            if isinstance(one, Sinusoids) and len(one.center) != self._dof:
                raise InputError(f"reference: expected {self._dof} joints, got {len(one.center)} for arm {arm}")
            self._references[arm], self._waves[arm] = one, len(one.amplitude) if isinstance(one, Sinusoids) else 0
        terms = max(int(self._waves.max()), self._terms) if self._waves.all() else 0
        if terms != self._terms or self._lanes is None:
            self._change_code(terms)
            arms = self.all
        if terms:
            for name, values in self._sines(arms)._asdict().items():
                self._lanes.held.put(name, arms, values)
        else:
            self._sample()

    def _sample(self) -> None:
        settings = self._dof, self.single.control_period, self.single.look_ahead, PREVIEW_BLOCK
        known = {id(preview.reference): preview for preview in self._previews}
        given = {id(one): one for one in self._references if one is not None}
        self._previews = [known.get(key) or Preview(one, *settings) for key, one in given.items()]
        places = {key: place for place, key in enumerate(given)}
        self._places = np.array([places.get(id(one), -1) for one in self._references])

    def _change_code(self, terms: int) -> None:
        before, self._terms, self._previews = self._lanes, terms, []
        self._lanes = self._ensemble()
        if before is not None:
            for name in before.state.columns:
                self._lanes.state[name] = before.state[name]
            self._lanes.held["parameters"] = self.parameters

    def _ensemble(self) -> Ensemble:
        if self._terms not in self._steppers:
            plant = self.single.plant
            held = {"torque": plant.dof, "noise": plant.noise_size} | self._reference
            held["parameters"] = plant.mechanism.equations.parameters
            self._steppers[self._terms] = compile_step(
                self._step, state=plant.sizes, constants=held, name="vector_step", precision=self.precision
            )
        return self._steppers[self._terms].ensemble(self.count)

    @property
    def _form(self) -> ReferenceForm:
        return ReferenceForm(self._dof, self._terms)

    @property
    def _reference(self) -> dict[str, int]:
        """Lengths of the columns that define a reference."""
        if not self._terms:
            return {"row": (3 + len(self.single.look_ahead)) * self._dof}
        return self._form.shared | self._form.held

    def _row(self, **columns: Column) -> Column:
        if not self._terms:
            return columns["row"]
        now, *ahead = (self._form.point(columns, delay) for delay in (0.0, *self.single.look_ahead.tolist()))
        return Column(x for part in (*now, *(point.p for point in ahead)) for x in part)

    def _step(self, **columns: Column) -> tuple[Column, ...]:
        """Next plant state, observation, `Facts`, flags, true p, v and torque."""
        plant = self.single.plant
        row, after = self._row(**columns), plant.equation(columns)
        p, wanted_p = plant.primary(after.q), Column(row.of[: plant.dof])
        wanted_v = Column(row.of[plant.dof : 2 * plant.dof])
        judged = self.single.judgement.equation(p, after.v, wanted_p, wanted_v, after.applied_torque)
        facts = Facts(
            judged.reward,
            where(after.q @ after.q + after.v @ after.v < MAX_SQUARED_SUM, 1.0, 0.0),
            judged.lost,
            self._surely_works(after.q, p),
            plant.energy_equation(after.q, after.v, columns["parameters"], after.drives),
            after.clipped[0],
        )
        observation = Column((*after.measured_p, *after.measured_v, *row))
        return *after[:4], observation, Column((*facts, *after.flags)), Column((*p, *after.v, *after.applied_torque))

    def _surely_works(self, q: Column, p: Column) -> Scalar:
        """1 where loops are away from singularities and limits, else 0."""
        mechanism = self.single.mechanism
        if mechanism.continuation is None:
            return 1.0
        sure = mechanism.continuation.surely_regular(q)
        description = mechanism.description
        joints = [description.joint_names[i] for i in description.primary]
        for condition in description.loops.conditions if description.loops else ():
            total = Column(condition.weights.get(name, 0.0) for name in joints) @ p
            sure = where(total > condition.lower, where(total < condition.upper, sure, 0.0), 0.0)
        return sure

    def _load(self, arms: Numbers) -> Array:
        """True parameters (k, P) of some arms."""
        plant, rows = self.single.plant, self._own[arms]
        times = self.single.control_period * self.steps[arms]
        for time in np.unique(times).tolist() if plant.loads else ():
            now = times == time
            rows[now] = plant.parameters(rows[now], time)
            self.payload[arms[now]], self._until[arms[now]] = plant.payload_mass(time), plant.next_change_time(time)
        parameters = self.parameters.copy()
        parameters[arms] = rows
        self.parameters = frozen(parameters)
        self._lanes.held.put("parameters", arms, rows)
        return rows

    def _reload(self, told: Told) -> None:
        due = np.flatnonzero(told["time"] >= self._until)
        if due.size:
            q, drives = (self._lanes.state[name][due] for name in ("q", "drives"))
            told["energy"][due] = self._energy.map(q, told["v"][due], self._load(due), drives)

    def _terminated(self, facts: Facts) -> Flags:
        terminated: Flags = facts.lost > 0.0
        doubtful = np.flatnonzero(facts.sure < 1.0) if self._loops else self.all[:0]
        if doubtful.size:
            terminated[doubtful] |= ~self.single.plant.is_valid_configuration(self._lanes.state["q"][doubtful])
        return terminated

    def _validate_finite(self, finite: Array, moving: Numbers) -> None:
        lost = moving[finite[moving] < 1.0] if not finite.all() else moving[:0]
        if lost.size:
            time = self.single.control_period * self.steps[lost[0]]
            raise NonFiniteError(
                f"{self.single.mechanism.name}: the motion of arm {lost[0]} diverged after {time:g} s; use a shorter "
                "control period, smaller actions or a smaller error bound, and check that the mass matrix is positive "
                "definite"
            )

    @cached_property
    def _energy(self) -> Kernel:
        sizes = self.single.plant.sizes
        sizes = {name: sizes[name] for name in ("q", "v")} | {
            "parameters": self.single.mechanism.equations.parameters,
            "drives": sizes["drives"],
        }
        return compile_function(self.single.plant.energy_equation, sizes, name="energy")

    def __getstate__(self) -> tuple[State, list[dict[str, Array]]]:
        parts = () if self._lanes is None else (self._lanes.state, self._lanes.held)
        kept, read_only = without_caches(self)
        made: dict[str, Any] = {"_lanes": None, "_steppers": {}, "_kernels": {}}
        return (kept | made, read_only), [{name: part[name] for name in part.columns} for part in parts]

    def __setstate__(self, given: tuple[State, list[dict[str, Array]]]) -> None:
        state, columns = given
        restored(self, state)
        if columns:
            self._lanes = self._ensemble()
            for part, values in zip((self._lanes.state, self._lanes.held), columns, strict=True):
                for name, column in values.items():
                    part[name] = column
