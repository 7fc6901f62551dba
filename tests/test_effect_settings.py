"""Settings of effects, identification, tuning and runs that cannot be are refused in a line that names them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from robot_files import urdf
from sampled_loops import arm
from synthetic_logs import known

from adaptctl.control import ComputedTorque
from adaptctl.errors import InputError, MissingExtraError, NotFoundError
from adaptctl.identification import Identification, identify
from adaptctl.identification.choice import choose
from adaptctl.identification.gathering import gathered
from adaptctl.identification.identify import identified
from adaptctl.identification.instruments import freed_of_noise
from adaptctl.simulation import Plant, Rollout, RungeKutta4, RunLogger
from adaptctl.simulation.effects import (
    ActuatorLag,
    ControlDelay,
    ElasticJoints,
    Encoder,
    FilteredDifferences,
    Friction,
    Payload,
    PayloadHeld,
    PlantEffects,
    TorqueLimit,
    TorqueRateLimit,
)
from adaptctl.simulation.integrator import integration
from adaptctl.simulation.systems import closed_loop_system, controller_system, mechanism_system, plant_system
from adaptctl.tuning import tune

TEXT, NAN = cast(Any, "a"), cast(Any, np.nan)
UR5 = urdf("ur5_robot.urdf")


def fitted(effect: Any) -> None:
    effect.validate(3, ("link1", "link2", "link3"), 1e-3)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: ControlDelay(NAN), "control delay: expected a whole number of control periods, got nan"),
        (lambda: ControlDelay(cast(Any, 2.0)), "control delay: expected a whole number of control periods, got 2.0"),
        (lambda: ControlDelay(TEXT), "control delay: expected a whole number of control periods, got 'a'"),
        (lambda: ActuatorLag(TEXT), "actuator lag: expected a positive number of s, got 'a'"),
        (lambda: ActuatorLag(cast(Any, [1.0, 2.0])), "actuator lag: expected a positive number of s"),
        (lambda: FilteredDifferences(TEXT), "filtered differences: cutoff: expected a positive number of Hz, got 'a'"),
        (
            lambda: Friction(stribeck_speed=TEXT),
            "friction: stribeck_speed: expected a positive number of rad/s, got 'a'",
        ),
        (lambda: fitted(Friction(viscous=TEXT)), "friction: viscous: expected numbers, got 'a'"),
        (lambda: fitted(Encoder(noise=TEXT)), "encoder: noise: expected numbers, got 'a'"),
        (lambda: fitted(TorqueLimit(TEXT)), "torque limit: expected numbers, got 'a'"),
        (lambda: fitted(TorqueRateLimit(TEXT)), "torque rate limit: expected numbers, got 'a'"),
        (lambda: fitted(ElasticJoints(TEXT)), "elastic joints: stiffness: expected numbers, got 'a'"),
        (lambda: ElasticJoints(1.0, encoders=cast(Any, 1)), "elastic joints: encoders: expected 'link' or 'motor'"),
        (lambda: PayloadHeld(TEXT), "payload: mass: expected a number, got 'a'"),
        (lambda: Payload(True), "payload: mass: expected a number, got True"),
        (lambda: PayloadHeld(1.0, TEXT), "payload: start: expected a number, got 'a'"),
        (lambda: PayloadHeld(1.0, 0.0, TEXT), "payload: stop: expected a number, got 'a'"),
        (lambda: PayloadHeld(1.0, 0.0, NAN), "payload: expected a start before its stop"),
        (lambda: PlantEffects.of(cast(Any, ControlDelay(1))), r"expected a sequence, such as \[ControlDelay\(2\)\]"),
        (lambda: Payload(1.0).added_to(np.zeros(30), 3), "payload: link: expected a whole number from 0 to 2, got 3"),
        (lambda: Payload(1.0).added_to(np.zeros(30), -1), "payload: link: expected a whole number from 0 to 2"),
        (lambda: Payload(1.0).added_to(np.zeros(30), cast(Any, 0.5)), "payload: link: expected a whole number"),
        (lambda: Payload(1.0).added_to(0.0, 0), "payload: link: expected a whole number"),
        (lambda: Payload(1.0).added_to(cast(Any, ["a"]), 0), "payload: parameters: expected numbers"),
    ],
)
def test_effects_that_cannot_be_are_refused(make: Callable[[], object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()


def test_a_delay_is_a_whole_number_of_any_kind() -> None:
    assert ControlDelay(cast(Any, np.int64(2))).initial_state(np.zeros(3), 1e-3).shape == (6,)


def test_a_payload_without_a_mass_is_no_unknown_name() -> None:
    with pytest.raises(InputError, match="payload: the mass is missing; entries: mass, center, inertia") as raised:
        Payload.of({})
    assert not isinstance(raised.value, NotFoundError)


def test_a_payload_is_added_to_a_link_that_there_is() -> None:
    held = PayloadHeld(1.0, link="hand")
    with pytest.raises(NotFoundError, match="payload: unknown link 'hand'; links: link1, link2"):
        held.loaded(np.zeros(20), ("link1", "link2"), 0.0)
    given = np.zeros(25)
    np.testing.assert_array_equal(np.flatnonzero(held.loaded(given, ("hand", "link2"), 0.0)), [0])
    assert not given.any()


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"logs": []}, "logs: expected at least one log"),
        ({"sample_rate": 0.0}, "sample_rate: expected a positive number of Hz, got 0.0"),
        ({"sample_rate": -250.0}, "sample_rate: expected a positive number of Hz, got -250.0"),
        ({"sample_rate": NAN}, "sample_rate: expected a positive number of Hz, got nan"),
        ({"sample_rate": TEXT}, "sample_rate: expected a positive number of Hz, got 'a'"),
        ({"cutoff": 0.0}, "cutoff: expected a positive number of Hz, got 0.0"),
        ({"cutoff": TEXT}, "cutoff: expected a positive number of Hz, got 'a'"),
        ({"prior_weight": 0.0}, "prior_weight: expected a positive number, got 0.0"),
        ({"prior_weight": -1.0}, "prior_weight: expected a positive number, got -1.0"),
        (
            {"drives": "d.toml", "columns": {"time": "t"}},
            "columns, units: expected none, because the drives specify them",
        ),
        (
            {"drives": "d.toml", "units": {"time": "s"}},
            "columns, units: expected none, because the drives specify them",
        ),
    ],
)
def test_identifications_that_cannot_be_are_refused(settings: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        identify(**cast(Any, {"logs": "log.csv", "robot": UR5} | settings))


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"cutoff": 0.0}, "cutoff: expected a positive number of Hz"),
        ({"cutoff": 1e3}, "cutoff: expected between .* and .* Hz for these logs, got 1000"),
        ({"cutoff": 1e5}, "cutoff: expected between .* and .* Hz for these logs, got 100000"),
        ({"cutoff": 1e-9}, "cutoff: expected between .* and .* Hz for these logs, got 1e-09"),
        ({"prior_weight": 0.0}, "prior_weight: expected a positive number, got 0.0"),
    ],
)
def test_what_the_logs_do_not_allow_is_refused(settings: dict[str, float], says: str) -> None:
    case = known(0)
    with pytest.raises(InputError, match=says):
        identified(case.guess, case.drives, [case.log], [case.log], **cast(Any, settings))


def test_a_given_zero_is_not_the_default() -> None:
    case = known(0)
    evidence, _, _ = gathered(case.guess, case.drives, [case.log])
    with pytest.raises(InputError, match=r"prior_weight: expected a positive number, got 0\.0"):
        choose(evidence, weight=0.0)
    with pytest.raises(InputError, match=r"cutoff: expected one of .* Hz, got 0\.0"):
        choose(evidence, cutoff=0.0)


def test_a_cutoff_that_instruments_leave_no_rows_at_is_refused() -> None:
    case = known(0)
    evidence, _, _ = gathered(case.guess, case.drives, [case.log], cutoff=60.0)
    with pytest.raises(InputError, match=r"cutoff: expected one of .* Hz, got 60\.0"):
        choose(freed_of_noise(evidence), cutoff=60.0)


def test_deviations_are_not_inflated_where_all_are_zero() -> None:
    inflation = cast(Any, Identification.deviation_ratio).fget
    assert inflation(SimpleNamespace(deviations=np.zeros(3), nominal_deviations=np.zeros(3))) == 1.0
    assert inflation(SimpleNamespace(deviations=np.full(2, 3.0), nominal_deviations=np.array([0.0, 2.0]))) == 1.5


def logged(**given: Any) -> Rollout:
    p = np.zeros((5, 3))
    return Rollout.from_arrays(**cast(Any, {"p": p, "torque": p, "reference_p": p, "control_period": 1e-3} | given))


def test_a_run_of_arrays_took_no_time_of_a_computer() -> None:
    assert logged().wall_time == 0.0


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: tune(arm("puma560_arm3"), seed=-1), "seed: expected a whole number of at least 0, got -1"),
        (lambda: tune(arm("puma560_arm3"), seed=cast(Any, 0.5)), "seed: expected a whole number of at least 0"),
        (lambda: logged(estimate=1.0), r"estimate: expected shape \(5, k\), got \(\)"),
        (lambda: logged(estimate=np.zeros(5)), r"estimate: expected shape \(5, k\), got \(5,\)"),
        (lambda: logged(estimate=np.zeros((4, 2))), r"estimate: expected shape \(5, 2\), got \(4, 2\)"),
        (lambda: logged(estimate=TEXT), "estimate: expected numbers, got 'a'"),
        (lambda: logged(estimate=[[1.0], [1.0, 2.0]]), "estimate: expected numbers"),
        (lambda: logged(p=[[1.0], [1.0, 2.0]]), "p: expected numbers"),
        (lambda: logged(torque=[[1.0], [1.0, 2.0]]), "torque: expected numbers"),
        (lambda: logged(time=[[1.0], [1.0, 2.0]]), "time: expected numbers"),
        (lambda: tune(arm("puma560_arm3"), seed=True), "seed: expected a whole number of at least 0, got True"),
        (lambda: RunLogger(3, 1e-3, joints=("one", "two")), "joints: expected 3 names, got 2"),
        (lambda: RunLogger(3, 1e-3, joints=cast(Any, 3)), "joints: expected 3 names, got 3"),
        (lambda: RunLogger(3, 1e-3, joints=cast(Any, "abc")), "joints: expected 3 names, got 'abc'"),
        (lambda: RunLogger(2, 1e-3, joints=("a", "a")), "joints: expected unique names, got a, a"),
        (lambda: logged().to_pandas(cast(Any, 3)), "joints: expected 3 names, got 3"),
        (lambda: logged().to_arrow(cast(Any, [1, 2, 3])), r"joints: expected 3 names, got \[1, 2, 3\]"),
        (lambda: logged().plot(cast(Any, 3)), "joints: expected 3 names, got 3"),
        (lambda: Plant(arm("puma560_arm3"), 1e-3, 1, cast(Any, 3)), r"integrator: expected .* RungeKutta4\(\), got 3"),
        (lambda: Plant(arm("puma560_arm3"), 1e-3, 1, cast(Any, RungeKutta4)), "integrator: expected .* got <class"),
        (lambda: integration(arm("puma560_arm3"), (), 1e-3, cast(Any, 3)), "integrator: expected an Integrator"),
    ],
)
def test_runs_that_cannot_be_are_refused(make: Callable[[], object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()


def test_a_log_is_not_lost_for_its_names(tmp_path: Path) -> None:
    with RunLogger(1, 1e-3, tmp_path / "run.parquet", joints=("elbow",)) as log:
        for k in range(3):
            log.append(1e-3 * k, [0.0], [0.0], cast(Any, ([0.0], [0.0], [0.0])), [0.0])
    assert "p.elbow" in Rollout.load(tmp_path / "run.parquet").to_arrow(["elbow"]).column_names


@pytest.mark.parametrize(
    ("package", "make", "what"),
    [
        (
            "matplotlib.figure",
            lambda: logged().plot(),
            "Rollout.plot needs matplotlib: pip install 'adaptctl\\[report\\]'",
        ),
        ("matplotlib.figure", lambda: logged()._repr_html_(), "the figure of a Rollout needs matplotlib: pip"),
        (
            "pyarrow.parquet",
            lambda: logged().save("run.parquet"),
            "the file of a run needs pyarrow: pip install 'adaptctl\\[report\\]'",
        ),
        ("pyarrow.parquet", lambda: RunLogger(3, 1e-3, "run.parquet"), "the file of a run needs pyarrow: pip install"),
        ("control", lambda: mechanism_system(arm("puma560_arm3")), "mechanism_system needs control: pip install"),
        ("control", lambda: plant_system(plant()), "plant_system needs control: pip install control"),
        ("control", lambda: controller_system(law(), 1e-3), "controller_system needs control: pip install control"),
        ("control", lambda: closed_loop_system(plant(), law()), "closed_loop_system needs control: pip install"),
    ],
)
def test_a_missing_package_is_named(
    package: str, make: Callable[[], object], what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=what):
        make()


def plant() -> Plant:
    return Plant(arm("puma560_arm3"), 1e-3)


def law() -> ComputedTorque:
    return ComputedTorque(arm("puma560_arm3"), np.full(3, 8.0))
