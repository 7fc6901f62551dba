"""Every public class can be sent: instances of all of them, met within what is made here, come back as they were."""

from __future__ import annotations

import copy
import enum
import inspect
import pickle
import types
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import test_drive as driven
from comparisons import comparison
from every_effect import EFFECTS
from every_law import ARM, FEW, GAIN, LAWS, MODEL, of_two, slotine_li
from nightly import mostly_at_night, turn_by_turn
from synthetic_logs import known
from test_tunable import POINT, ticks

from adaptctl import codegen, control, envs, identifiability, recording, simulation
from adaptctl.control import BoundedGainForgetting
from adaptctl.description import Coupling, builtin_file
from adaptctl.dynamics import equation_costs, load
from adaptctl.experiments import EXPERIMENTS
from adaptctl.hardware import MuJoCoRobot, TouchEvent, drive
from adaptctl.identification import IdentifiedPayload, MujocoBodies
from adaptctl.identification.identify import identified
from adaptctl.simulation import effects
from adaptctl.tuning import tune

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

PACKAGES = (
    *("", ".control", ".control.adaptation", ".description", ".dynamics", ".envs", ".experiments", ".identifiability"),
    *(".identification", ".recording", ".simulation", ".simulation.effects", ".tuning"),
)
NOT_SENT = {"Period", "Result", "Live", "LiveView", "VideoRecorder"}
"""what lives for a tick or a call and holds functions made on the spot, has a process of its own, or needs moviepy"""
WAYS: tuple[Callable[[Any], Any], ...] = (copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x)))
ATOMS = (enum.Enum, int, float, complex, str, bytes, type(None), type, types.FunctionType, types.BuiltinFunctionType)
REST = np.zeros(3)
LARGE = ("composite learning", "floor")
"""laws that take long to compile, and are sent as `forgetting` is"""
SENT = {name: law for name, law in LAWS.items() if name not in LARGE}
SENT["forgetting"] = of_two(BoundedGainForgetting(FEW, 0.3, 15.0, 1.5, 3.0))
EACH = [(name, WAYS[k % 2]) for k, name in enumerate(SENT)]


def public_classes() -> set[type]:
    """All classes that are offered and that something can be an instance of."""
    offered = set()
    for package in (import_module(f"adaptctl{name}") for name in PACKAGES):
        names = getattr(package, "__all__", None) or [name for name in vars(package) if not name.startswith("_")]
        offered |= {thing for name in names if inspect.isclass(thing := getattr(package, name))}
    return {
        kind
        for kind in offered
        if kind.__module__.startswith("adaptctl.")
        and not (inspect.isabstract(kind) or getattr(kind, "_is_protocol", False) or issubclass(kind, BaseException))
    }


def parts(thing: Any) -> list[Any]:
    """What a thing is made of, as it is sent."""
    if isinstance(thing, np.ndarray) and thing.dtype != object:
        return []
    if isinstance(thing, dict | types.MappingProxyType):
        return [*thing.keys(), *thing.values()]
    if isinstance(thing, tuple | list):
        return list(thing)
    if isinstance(thing, set | frozenset):
        return sorted(thing, key=repr)
    if isinstance(thing, ATOMS):
        return []
    reduced = thing.__reduce_ex__(4)
    return [] if isinstance(reduced, str) else [part if i < 3 else list(part or ()) for i, part in enumerate(reduced)]


def validate_alike(sent: Any, own: Any, met: dict[int, Any]) -> None:
    """Both are of one kind and made of the same."""
    if id(own) in met:
        return
    met[id(own)] = own
    assert type(sent) in type(own).__mro__  # a law's memory comes back without its one array
    if isinstance(own, np.ndarray) and own.dtype != object:
        np.testing.assert_array_equal(sent, own)
        assert sent.flags.writeable == own.flags.writeable or not own.flags.owndata  # a view comes back as a copy
    elif isinstance(own, ATOMS):
        assert sent is own or sent == own or (sent != sent and own != own)
    else:
        for theirs, ours in zip(parts(sent), parts(own), strict=True):
            validate_alike(theirs, ours, met)


@cache
def run() -> simulation.Rollout:
    env = envs.TrackingEnv(ARM, control.Sinusoids(REST, 0.2 + REST, 0.3 + REST, REST), duration=2.0, error_bound=np.inf)
    return simulation.simulate(env, LAWS["gradient"])


def of_the_description() -> Any:
    gear = Coupling("gear", "a", "b", 2.0, 0.1)
    return [*EFFECTS, gear, *map(load, ("puma560_geared", "semi_direct_drive"))]


def of_the_offline_stage() -> Any:
    space = identifiability.essential_space(ARM)
    basis = identifiability.fundamental_basis(space, identifiability.Priority())
    constraints = identifiability.Constraints({"link0.m": 1.0}, (identifiability.Relation({"link1.m": 1.0}, 2.0),))
    flags = (
        identifiability.ResidualSingularValue(1e-12, ("link0.m",)),
        identifiability.NearRightAngle("a", "b", 90, 1e-4),
    )
    states = identifiability.random_states(ARM, 5, np.random.default_rng(0))
    model = identifiability.ReducedModel(ARM, basis)
    lift = identifiability.nearest_consistent(model, model.fundamental_parameters)
    return (
        identifiability.Priority(),
        space,
        basis,
        constraints,
        flags,
        states,
        model,
        lift,
        identifiability.reduce(space, ARM, energy_error=1.0),
    )


def of_control() -> Any:
    loop = control.ErrorFeedback(16.0, 8.0, 1e-3)
    gains = control.Gains.from_bandwidth(ARM, 4.0)
    places, times = np.linspace(0.0, 1.0, 8)[:, None] + REST, np.arange(8.0)
    spline = control.Spline(places, times)
    references = control.MinimumJerk(places, times), control.StoppedReference(spline, 2.0), control.FadeIn(spline, REST)
    linear = control.LinearController.state_feedback(np.ones((3, 6)), ARM)
    found = control.sampling_ratio(ARM, gains.damping, 1e-3), control.Workspace.within_limits(ARM)
    exciting = control.excitation_trajectory(MODEL, iterations=1)
    measured = (
        control.persistent_excitation(MODEL, run(), 1.0),
        control.monitor_stability(slotine_li(GAIN), run(), ARM, 50),
    )
    laws = control.GainDesign.from_bandwidth(ARM, 4.0), control.margins(loop.loop()), control.ReleasedGradient(GAIN)
    limits = control.MotionLimits(REST - 1.0, REST + 1.0, REST + 2.0, REST + 50.0)
    touch = LAWS["touch"].init(REST[:2], REST[:2]).law_state.touch, control.tool_wrench(ARM, REST, REST + 1.0)
    return loop, linear, gains, references, found, exciting, measured, laws, limits, control.PriorRanges(), POINT, touch


def of_simulation() -> Any:
    integrators = simulation.LinearlyImplicitEuler(), simulation.RungeKutta4(), simulation.SemiImplicitEuler()
    plant = simulation.Plant(ARM, 1e-3, effects=(effects.PayloadHeld(effects.Payload(1.0)), effects.ControlDelay(2)))
    state = plant.step(plant.init(REST, REST + 0.1), REST + 1.0)
    reference = control.Sinusoids(REST, 0.2 + REST, 0.3 + REST, REST)
    many = simulation.simulate_many(plant, LAWS["gradient"], reference, duration=0.05, batch_size=2)
    held = effects.PlantEffects(loads=(effects.PayloadHeld(1.0),))
    return (
        integrators,
        held,
        plant,
        state,
        many,
        run(),
        simulation.RunLogger(3, 1e-3, capacity=10),
        simulation.ClosedLoop(plant, LAWS["guarded"]),
        equation_costs(ARM),
    )


HAND = simulation.HandPush(np.array([0.0, 20.0, 0.0]), start=1.0, duration=5.0)


def of_environments() -> Any:
    reference = control.Sinusoids(REST, 0.2 + REST, 0.3 + REST, REST)
    made: list[Any] = [envs.TrackingEnv(ARM, reference), envs.VectorTrackingEnv(2, robot=ARM, reference=reference)]
    made += [envs.ResidualEnv(made[0], slotine_li(GAIN)), envs.MuJoCoTrackingEnv(), envs.ContactEnv(pushes=[HAND])]
    made += [envs.ResidualVectorEnv(made[1], slotine_li(GAIN)), envs.LearningEnv(made[0])]
    moved = slotine_li(GAIN), ["damping"]
    made += [envs.TuningEnv(made[0], *moved), envs.LearningVectorEnv(envs.TuningVectorEnv(made[1], *moved))]
    made += [envs.Puma560TrackingEnv(), envs.SemiDirectDriveTrackingEnv()]
    made += [envs.Puma560VectorTrackingEnv(num_envs=2), envs.SemiDirectDriveVectorTrackingEnv(num_envs=2)]
    for one in made:
        one.reset(seed=1)
        one.step(np.zeros(one.action_space.shape))
    return made, envs.TrackingEnv(ARM, reference).episode(seed=1)


def of_laws() -> Any:
    law = LAWS["guarded"]
    return [*LAWS.values(), law.step(law.init(REST, REST), REST, REST, POINT)[1]]


def of_recording() -> Any:
    made = comparison(ARM, 200)
    verdict = recording.Verdict.of([(recording.Failure.STOPPED, "it fell")])
    task_error = recording.TaskError("Distance", "mm", {"adaptive": np.zeros(3)})
    return (
        made,
        verdict,
        task_error,
        codegen.Exported(Path("arm"), "arm", ("arm.c",), {}),
        recording.Setting("a", "1", "b"),
        recording.Fact("a", "1", recording.RunRole.SUBJECT),
        EXPERIMENTS,
    )


def of_identification() -> Any:
    case = known(0, duration=4.0)
    return (
        identified(case.guess, case.drives, [case.log], [case.log]),
        case,
        IdentifiedPayload("log", "tool0", np.ones(10), np.eye(10)),
        MujocoBodies.of(mujoco.MjSpec.from_file(str(builtin_file("scene")))),
    )


def of_hardware() -> Any:
    robot = MuJoCoRobot(driven.ARM, control_period=driven.PERIOD, start=driven.CENTER)
    recorded = drive(robot, driven.LAW, driven.REFERENCE, duration=0.1)
    recorded = replace(recorded, rollout=run(), touches=(TouchEvent(1.0, "elbow", 3.0, 1.0),))
    return recorded, control.HeldState(LAWS["guarded"])


ROOTS: dict[str, Callable[[], Any]] = {
    "description and effects": of_the_description,
    "offline stage": of_the_offline_stage,
    "control": of_control,
    "laws": of_laws,
    "simulation": of_simulation,
    "environments": of_environments,
    "tuning": lambda: tune(ARM),
    "recording": of_recording,
    "identification": of_identification,
    "hardware": of_hardware,
}


@cache
def made(root: str) -> Any:
    return ROOTS[root]()


@pytest.mark.parametrize(("root", "sent"), turn_by_turn(ROOTS, WAYS))
def test_what_comes_back_is_what_was_sent(root: str, sent: Callable[[Any], Any]) -> None:
    validate_alike(sent(made(root)), made(root), {})


def test_an_instance_of_every_public_class_was_among_it() -> None:
    met: dict[int, Any] = {}
    for root in ROOTS:
        validate_alike(made(root), made(root), met)
    kinds = {kind for thing in met.values() for kind in type(thing).__mro__}
    missing = {kind.__name__ for kind in public_classes() - kinds}
    assert missing <= NOT_SENT, f"add {sorted(missing - NOT_SENT)} to every_law.py, every_effect.py or ROOTS"


@pytest.mark.parametrize(("name", "sent"), mostly_at_night(EACH, *EACH[::5]))
def test_laws_compute_the_same_before_and_after_use(name: str, sent: Callable[[Any], Any]) -> None:
    before = sent(slow := sent(SENT[name]))
    expected = ticks(slow)
    for other in (before, sent(slow)):
        for theirs, ours in zip(ticks(other), expected, strict=True):
            np.testing.assert_array_equal(theirs, ours)
