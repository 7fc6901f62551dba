"""One law on two plants, ours and MuJoCo: how far their motions are apart, and what explains it."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit, position_unit
from adaptctl.errors import InputError
from adaptctl.experiments.adaptive import AdaptiveTracking
from adaptctl.experiments.contest import Contender, Outcome, contest
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.learning import ADAPTATION_OFF, ADAPTIVE, Found
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import ControllerRun, Finding, Progress
from adaptctl.simulation.mujoco_plant import as_mujoco

if TYPE_CHECKING:
    import gymnasium
    import mujoco

FINE, OURS = "mujoco-fine", "adaptctl"
SHORTER = 4
"""Factor by which MuJoCo's steps are shorter in the run that shows the integrator's error."""
FIRST_ORDER = 0.5 * SHORTER
"""Least factor by which a difference shrinks at shorter steps, where it is the integrator's."""


@dataclass(frozen=True)
class TwoPlants(AdaptiveTracking):
    """Experiment on two simulators: Slotine and Li's law, the same to the bit, drives an arm in MuJoCo, in MuJoCo at a
    quarter of its time steps, and in adaptctl's own plant.

    MuJoCo's default integrator is semi-implicit and of first order, adaptctl's is Runge and Kutta's of fourth.
    Differences that remain at shorter steps come from contacts, joint stops, springs, and dry friction, which MuJoCo
    models as a constraint. Raises `InputError` at construction for a setting of the wrong type or out of its bounds,
    another plant than "mujoco", beside which adaptctl's runs anyway, and a floating base, `NonFiniteError` for NaN or
    infinity.
    """

    name: ClassVar[str] = "two-plants"
    title: ClassVar[str] = "{robot}: one law on two plants"

    plant: str = setting("mujoco", "the subject's plant: mujoco")

    def __post_init__(self) -> None:
        if self.plant != "mujoco":
            raise InputError(f"plant: expected mujoco, with which adaptctl's own is compared, got {self.plant!r}")
        super().__post_init__()

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: how much motions simulated by MuJoCo
        and by adaptctl differ, and why."""
        return (
            "The same adaptive controller, from estimates of zero and on the same reference, drives the arm as MuJoCo "
            "moves it and as adaptctl's own plant does. Where only integration differs, the motions come together as "
            "MuJoCo's steps shorten; contacts, joint stops, springs and dry friction remain."
        )

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """List of the controllers to compare, a `Contender` (name, label and controller) each, in the order in which
        they run: Slotine and Li's law on MuJoCo, the experiment's subject, and the same with adaptation off. `basis`, a
        `FundamentalBasis`, has the k fundamental (base) parameters that it adapts. Raises `GainError` for gains too
        large for the control period, `InputError` for a basis of another geometry than the mechanism's."""
        model = ReducedModel(mechanism, basis)
        return [
            Contender.of(ADAPTIVE, "Slotine-Li on MuJoCo", "nothing", self.slotine_li(model, self.adaptation(model))),
            Contender.of(ADAPTATION_OFF, "the same, adaptation off", "nothing", self.slotine_li(model)),
        ]

    def outcome(
        self, env: gymnasium.Env[Any, Any], mechanism: Mechanism, contenders: Sequence[Contender], progress: Progress
    ) -> Outcome:
        """Outcome of the contest, an `Outcome`: runs of the `contenders` (controllers with names) on the environment
        `env`, then of the first one in MuJoCo at a quarter of its time steps and in adaptctl's own plant, each with the
        arm `mechanism`. `env` is MuJoCo's. `progress(label, share)` is called with a run's label and the fraction of it
        done, 0 to 1. Ctrl-C keeps the runs that had begun; where there are none, `KeyboardInterrupt` is raised. Raises
        `GainError` for gains too large for the control period, `NonFiniteError` where a motion diverges to non-finite
        values."""
        done = super().outcome(env, mechanism, contenders, progress)
        try:
            for name, label, other in (
                (FINE, f"Slotine-Li on MuJoCo, steps {SHORTER} times shorter", _Finer(**_settings(self))),
                (OURS, "Slotine-Li on adaptctl's plant", AdaptiveTracking(**_settings(self) | {"plant": "adaptctl"})),
            ):
                if not done.complete:
                    break
                contender = replace(contenders[0], name=name, label=label)
                more = contest(other.environment(mechanism), mechanism, [contender], self.seed, progress, self.options)
                done = Outcome(mechanism, (*done.runs, *more.runs), more.complete)
        except KeyboardInterrupt:
            return replace(done, complete=False)
        return done

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each: the largest difference, rad (m), of
        any joint's position between MuJoCo and adaptctl's plant at MuJoCo's own steps and at a quarter of them.
        `outcome`, an `Outcome`, has the runs; `basis` is not used. Nothing is checked."""
        runs = {run.name: run for run in outcome.runs}
        for name, other, meaning in (
            ("plants_apart", ADAPTIVE, "at MuJoCo's own steps"),
            ("plants_apart_fine", FINE, f"at steps {SHORTER} times shorter"),
        ):
            if other in runs and OURS in runs:
                text = f"largest difference of a joint's position between MuJoCo and adaptctl's plant, {meaning}"
                yield Finding(name, _apart(runs[other], runs[OURS]), position_unit(outcome.mechanism), text)

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Sentence for the report, never None here, with the largest difference of joint positions between the two
        plants, mrad (mm), and whether MuJoCo's integrator explains it; `outcome`, an `Outcome`, has the runs, `found`
        the findings by name. Raises `KeyError` where that difference is not among these."""
        coarse, fine = found.of["plants_apart"], found.of["plants_apart_fine"]
        text = f"MuJoCo and adaptctl's plant are at most {1e3 * coarse:.2g} {error_unit(outcome.mechanism)} apart"
        if coarse < FIRST_ORDER * fine:
            return (
                f"{text}, and {1e3 * fine:.2g} at steps {SHORTER} times shorter: integration does not explain it, but "
                "contacts, joint stops, springs or dry friction do, which only MuJoCo has, or models otherwise."
            )
        return (
            f"{text}, and {1e3 * fine:.2g} at steps {SHORTER} times shorter: the difference is MuJoCo's integrator's."
        )


@dataclass(frozen=True)
class _Finer(AdaptiveTracking):
    """The same on MuJoCo at shorter steps."""

    name: ClassVar[str] = FINE
    title: ClassVar[str] = ""

    def scene(self, mechanism: Mechanism) -> mujoco.MjModel:
        """The model with shorter steps."""
        model = copy.copy(as_mujoco(super().scene(mechanism)))
        model.opt.timestep = min(model.opt.timestep, self.control_period) / SHORTER
        return model


def _settings(experiment: TwoPlants) -> dict[str, Any]:
    return {entry.name: getattr(experiment, entry.name) for entry in fields(experiment)}


def _apart(one: ControllerRun, other: ControllerRun) -> float:
    common = min(len(one.rollout.time), len(other.rollout.time))
    return float(np.abs(one.rollout.p[:common] - other.rollout.p[:common]).max())
