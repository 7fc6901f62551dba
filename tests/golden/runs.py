"""What short runs, recordings and an identification compute, each array by four numbers."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from golden import capture
from golden.pictures import told

HEXADECIMAL = re.compile(r"-?0x[0-9a-f.]+p[+-]?\d+")


def law_of_two(name: str) -> Any:
    return capture.arms()["two"][name]


def swinging(law: Any) -> Any:
    from adaptctl.control import Sinusoids

    return Sinusoids(np.zeros(law.dof), np.full(law.dof, 0.3), 1.0 + np.arange(law.dof))


def simulated(effects: str) -> dict[str, str]:
    """A run of half a second with effects."""
    from every_effect import RIGID

    from adaptctl.envs import TrackingEnv
    from adaptctl.simulation import Rollout, simulate
    from adaptctl.simulation.effects import ElasticJoints

    elastic = ElasticJoints(1e4, motor_inertia=0.1)
    law, chosen = law_of_two("guarded"), {"none": [], "rigid": RIGID, "elastic": [elastic]}[effects]
    more: dict[str, Any] = {"effects": chosen, "torque_limits": 4.0, "error_bound": np.inf}
    env = TrackingEnv(law.inner.model.mechanism, swinging(law), duration=0.5, initial_error=0.05, **more)
    run = simulate(env, law, seed=3)
    arrays = {one.name: getattr(run, one.name) for one in fields(Rollout) if one.name != "wall_time"}
    return {name: told(value) for name, value in arrays.items() if isinstance(value, np.ndarray | float)}


def tried() -> dict[str, str]:
    """Trials of a tuning with noisy encoders, of which one has twice the damping and late torques."""
    from adaptctl.simulation.effects import Encoder, FilteredDifferences
    from adaptctl.tuning.stated_effects import plant_with
    from adaptctl.tuning.trial_runs import run_trials

    law = law_of_two("gradient")
    mechanism = law.model.mechanism
    plant = plant_with(mechanism, 1e-3, np.full(2, 20.0), (FilteredDifferences(80.0), Encoder(1e-3, 1e-3, 1e-2)))
    laws, true = [law, law.having({"damping": 2.0 * law.damping})], np.tile(mechanism.inertial_parameters, (2, 1))
    runs = run_trials(plant, laws, swinging(law), np.full(2, 0.05), 0.5, true, np.array([False, True]))
    return {name: told(values) for name, values in runs._asdict().items()}


def recorded(name: str) -> str:
    """Numbers with which exported C is tested."""
    import adaptctl

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "law"
        adaptctl.export(law_of_two(name), path, without_safety_filter=True, large_stack=True)
        return told([float.fromhex(x) for x in HEXADECIMAL.findall((path / "vectors.h").read_text())])


def shown(name: str) -> dict[str, str]:
    """A loop in a page: the length of its code, and what the page knows of it."""
    from adaptctl.codegen.live_arm import LiveArm, live_arm
    from adaptctl.simulation import Plant

    law = law_of_two(name)
    mechanism = law.model.mechanism
    plant, first = Plant(mechanism, 1e-3), np.full(law.dof, 0.05)
    live = live_arm(
        plant, law, swinging(law), plant.init(first, 0.0 * first), np.asarray(mechanism.inertial_parameters)
    )
    assert isinstance(live, LiveArm)
    facts = capture.flattened(live.facts)
    return {"binary": told(len(live.binary)), **{key: told(x) for key, x in facts}}


def identified() -> dict[str, str]:
    """Parameters from eight seconds of a noisy log, and how the model was chosen."""
    from synthetic_logs import known

    from adaptctl.identification.identify import identified

    case = known(5, links=2, duration=8.0, rate=200.0)
    found = identified(case.guess, case.drives, [case.log], [case.log])
    names = ("estimate", "deviations", "nominal_deviations", "intervals", "prior_ranges", "components")
    trials = [trial.relative_error for trial in found.choice.trials]
    errors = found.validation.relative_error, found.validation_in_band.relative_error
    return {name: told(getattr(found, name)) for name in names} | {"trials": told(trials), "errors": told(errors)}


def searched() -> dict[str, str]:
    """Parameters and errors after five steps of searches for consistent estimates, from afar and from near."""
    from test_consistent_estimates import problem, tiny

    from adaptctl.identification.consistent_estimate import SMALL_SLOPE
    from adaptctl.identification.interior_point import Newton, Problems

    found = {}
    cases = {"far": (problem(3), False), "edge": (tiny(0), False), "near": (tiny(0), True)}
    for name, (given, near) in cases.items():
        A, b, prior, weight = given
        own = Problems.made(A[None], b[None], prior, weight)
        point = own.start(prior.start(len(b))[None], near)
        for _ in range(5):
            point = Newton(own, point).next_point(SMALL_SLOPE)
        ends = Newton(own, point)
        numbers = {"x": point.x[0], "error": ends.error[0], "fall": ends.fall[0], "residual": own.residual(point.x)}
        found |= {f"{name}: {what}": told(value) for what, value in numbers.items()}
    return found


RUNS: Mapping[str, Callable[[], Any]] = {
    **{f"run, {effects} effects": partial(simulated, effects) for effects in ("none", "rigid", "elastic")},
    **{f"recorded, {law}": partial(recorded, law) for law in ("guarded", "tool in the world", "linear")},
    "in a page, gradient": partial(shown, "gradient"),
    "tried": tried,
    "identified": identified,
    "searched": searched,
}


def runs() -> dict[str, Any]:
    return {name: compute() for name, compute in RUNS.items()}
