"""Settings of identifiability, identification and recording that cannot be are refused in a line that names them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from sampled_loops import arm, full
from test_own_runs import motion

import adaptctl
from adaptctl.arrays import Array
from adaptctl.errors import FileError, InputError, NonFiniteError
from adaptctl.identifiability import (
    Constraints,
    EssentialSpace,
    FundamentalBasis,
    Priority,
    ReducedModel,
    Relation,
    constrained,
    essential_space,
    fundamental_basis,
    nearest_consistent,
    random_states,
    reduce,
)
from adaptctl.identifiability.sampling import States, random_halves, states_within_limits
from adaptctl.identification.drives_file import Drives, MotorEntry, Units
from adaptctl.identification.identification import Identification
from adaptctl.identification.validation import Validation
from adaptctl.recording import compared_runs, write_artifacts

TEXT = cast(Any, "a")
NONE = cast(Any, None)
PAIR = ["link1.m", "link2.m"]
GENERATOR = np.random.default_rng(0)


def puma() -> adaptctl.Mechanism:
    return arm("puma560_arm3")


def space() -> EssentialSpace:
    return essential_space(puma())


def basis(**other: Any) -> FundamentalBasis:
    return replace(fundamental_basis(space()), **other)


def states(samples: int = 5) -> States:
    return States(np.zeros((samples, 3)), np.zeros((samples, 3)), "here")


def drives(**given: Any) -> Drives:
    motors = tuple(MotorEntry(name=name, position=f"p.{name}", torque=f"tau.{name}") for name in "ab")
    own = {"joints": ("a", "b"), "transmission": np.array([[2.0, 0.0], [1.0, 4.0]]), "offsets": np.array([0.5, 0.0])}
    return Drives(**{**own, "motors": motors, "time": "time", "units": Units(1.0, 1.0, 1.0), **given})


def validation(error: Array) -> Validation:
    return Validation("made", 5.0, np.arange(0.0, len(error)), np.ones(error.shape), 1.0 + error)


def identified() -> Identification:
    """An identification of which only deviations and model are known."""
    model = full("puma560_arm3")
    blank: dict[str, Any] = dict.fromkeys(Identification.__dataclass_fields__)
    return Identification(**{**blank, "model": model, "deviations": np.ones(len(model.names))})


def without_one(model: str) -> ReducedModel:
    return ReducedModel.full(constrained(arm(model), Constraints({"link1.m": 1.0})))


def runs(**second: Array) -> Mapping[str, adaptctl.Rollout]:
    given = {**motion(2), "control_period": 1e-3}
    return {name: adaptctl.Rollout.from_arrays(**{**given, **more}) for name, more in (("one", {}), ("two", second))}


def two_link() -> adaptctl.Mechanism:
    return adaptctl.load("two_link")


def run_and_nothing() -> Mapping[str, adaptctl.Rollout]:
    one = runs()["one"]
    none: dict[str, Any] = {name: value[:0] for name, value in vars(one).items() if isinstance(value, np.ndarray)}
    return {"one": one, "two": replace(one, **none)}


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Priority().indices(["link1.m", "joint1.viscous"]), "'joint1.viscous': expected an inertial parameter"),
        (lambda: Priority().indices(["elbow"]), "'elbow': expected an inertial parameter"),
        (
            lambda: Constraints.from_matrix([1.0, 2.0], ["link1.m"] * 2),
            "names: expected unique names, got 'link1.m' more than once",
        ),
        (lambda: Constraints.from_matrix(np.ones((1, 2, 2)), PAIR), r"expected a matrix \(m, 2\) .*, got \(1, 2, 2\)"),
        (lambda: Priority().indices(["link1.m"] * 2), "parameter 'link1.m' is given more than once"),
        (lambda: Constraints(NONE), "known: expected a mapping from parameters' names to numbers, got None"),
        (lambda: Constraints(TEXT), "known: expected a mapping from parameters' names to numbers, got 'a'"),
        (lambda: Constraints({cast(Any, 1): 1.0}), "known: expected a mapping from parameters' names to numbers"),
        (lambda: Constraints(relations=NONE), "relations: expected Relations, got None"),
        (lambda: Constraints(relations=TEXT), "relations: expected Relations, got 'a'"),
        (
            lambda: Constraints(relations=cast(Any, Relation({"link1.m": 1.0}, name="fork"))),
            "relations: expected Relations, got Relation",
        ),
        (lambda: Relation(NONE), "relation: weights: expected a mapping from parameters' names to numbers, got None"),
        (lambda: Relation(NONE, name="fork"), "relation 'fork': weights: expected a mapping"),
        (lambda: constrained(puma(), Constraints(), TEXT), "priority: expected a Priority or None, got 'a'"),
        (lambda: Relation({"link1.m": TEXT}), "relation: weight of 'link1.m': expected a number, got 'a'"),
        (lambda: Relation({"link1.m": cast(Any, [1.0, 2.0])}), "relation: weight of 'link1.m': expected a number"),
        (lambda: Relation({"link1.m": 1.0}, TEXT), "relation: value: expected a number, got 'a'"),
        (lambda: Relation({"link1.m": 1.0}, TEXT, "fork"), "relation 'fork': value: expected a number, got 'a'"),
        (lambda: essential_space(puma(), seed=-1), "seed: expected a whole number from 0 to .*, got -1"),
        (lambda: essential_space(puma(), seed=cast(Any, 0.5)), "seed: expected a whole number"),
        (lambda: essential_space(puma(), samples=TEXT), "samples: expected a whole number, .*, got 'a'"),
        (
            lambda: essential_space(puma(), samples=cast(Any, 1000.0)),
            "samples: expected a whole number, at least twice the 30 parameters, got 1000.0",
        ),
        (lambda: essential_space(puma(), samples=cast(Any, np.nan)), "samples: expected a whole number, .*, got nan"),
        (lambda: essential_space(puma(), states=TEXT), "states: expected States or None, got 'a'"),
        (lambda: essential_space(puma(), prove=TEXT), "prove: expected True, False or None, got 'a'"),
        (lambda: essential_space(puma(), prove=cast(Any, 1)), "prove: expected True, False or None, got 1"),
        (lambda: random_states(puma(), -3, GENERATOR), "samples: expected a whole number from 2 to .*, got -3"),
        (lambda: random_states(puma(), cast(Any, 5.5), GENERATOR), "samples: expected a whole number"),
        (lambda: random_halves(puma(), 1, GENERATOR), r"^samples: expected a whole number from 2 to .*, got 1$"),
        (lambda: random_halves(puma(), cast(Any, 5.5), GENERATOR), "^samples: expected a whole number"),
        (lambda: random_halves(puma(), cast(Any, 5000.5), GENERATOR), "^samples: expected a whole number"),
        (lambda: states_within_limits(puma(), -3), "samples: expected a whole number from 2 to .*, got -3"),
        (lambda: states_within_limits(puma(), 5, seed=-1), "seed: expected a whole number from 0 to .*, got -1"),
        (lambda: states().split(0), "split: max_size: expected a whole number from 2 to .*, got 0"),
        (lambda: states().split(-2), "split: max_size: expected a whole number"),
        (lambda: states(2).split(1), "split: max_size: expected a whole number"),
        (
            lambda: reduce(space(), puma(), components=cast(Any, 2.5)),
            "components: expected a whole number from 0 to .*, got 2.5",
        ),
        (
            lambda: reduce(space(), puma(), components=2).parameters(cast(Any, 1.5)),
            "components: expected a whole number from 0 to .*, got 1.5",
        ),
        (
            lambda: reduce(space(), puma(), components=True),
            "components: expected a whole number from 0 to .*, got True",
        ),
        (lambda: reduce(space(), puma(), components=2).parameters(True), "components: expected a whole number"),
        (lambda: reduce(space(), puma(), energy_error=TEXT), "energy_error: expected a number, got 'a'"),
        (lambda: basis(gap=np.inf), "gap: expected a positive finite number, got inf"),
        (lambda: basis(gap=0.0), "gap: expected a positive finite number, got 0.0"),
        (lambda: basis(gap=TEXT), "gap: expected a positive finite number, got 'a'"),
        (lambda: basis(gap=np.ones(2)), "gap: expected a positive finite number, got array"),
        (lambda: basis(columns=TEXT), r"columns: expected ascending indices in 0\.\.29, got 'a'"),
        (lambda: basis(columns=None), r"columns: expected ascending indices in 0\.\.29, got None"),
        (lambda: basis(columns=(0.0, 1.0)), r"columns: expected ascending indices in 0\.\.29, got \(0.0, 1.0\)"),
        (lambda: ReducedModel(puma(), TEXT), "basis: expected a FundamentalBasis or None, got 'a'"),
        (lambda: fundamental_basis(space(), TEXT), "priority: expected a Priority or None, got 'a'"),
        (lambda: fundamental_basis(space(), cast(Any, [])), r"priority: expected a Priority or None, got \[\]"),
        (lambda: fundamental_basis(space(), tolerance=TEXT), "tolerance: expected a number, got 'a'"),
        (lambda: validation(np.eye(4)).autocorrelation(-1), "lags: expected a whole number from 0 to .*, got -1"),
        (lambda: validation(np.eye(4)).autocorrelation(cast(Any, 1.5)), "lags: expected a whole number"),
        (lambda: validation(np.zeros((0, 2))), r"validation: .* of one shape \(n, r\), n and r at least 1, got"),
        (lambda: validation(np.zeros(2)), r"validation: .* of one shape \(n, r\)"),
        (lambda: replace(validation(np.eye(4)), predicted=np.ones((3, 4))), r"validation: .* and \(3, 4\)"),
        (
            lambda: nearest_consistent(without_one("puma560_arm3"), np.ones(29)),
            "puma560_arm3: expected a mechanism without constraints, .*, got 29 of 30 parameters",
        ),
        (lambda: compared_runs(two_link(), run_and_nothing()), "run 'two': expected at least one sample"),
        (lambda: drives(transmission=np.eye(3)), r"drives: transmission: expected shape \(2, 2\), got \(3, 3\)"),
        (lambda: drives(transmission=TEXT), "drives: transmission: expected numbers"),
        (lambda: drives(transmission=np.ones((2, 2))), "drives: transmission: the matrix is singular"),
        (lambda: drives(transmission=np.zeros((2, 2))), r"drives: transmission\[0\]: motor 'a' must turn its own"),
        (lambda: drives(transmission=1.0 - np.eye(2)), r"transmission\[0\]: .* must turn its own joint 'a'"),
        (lambda: drives(offsets=0.0), r"drives: offsets: expected shape \(2,\), got \(\)"),
        (lambda: drives(motors=()), r"drives: motors: expected one per joint \(2\), got 0"),
        (lambda: drives().position(np.zeros(3)), r"drives: positions: expected shape \(..., 2\), got \(3,\)"),
        (lambda: drives().velocity(TEXT), "drives: velocities: expected numbers"),
        (lambda: drives().torque(np.zeros((2, 1))), r"drives: torques: expected shape \(..., 2\), got \(2, 1\)"),
        (lambda: identified().adaptation_gain(-1.0), "adaptation gain: rate: expected a positive number, got -1.0"),
        (lambda: identified().adaptation_gain(np.inf), "adaptation gain: rate: expected a positive number, got inf"),
        (lambda: identified().adaptation_gain(TEXT), "adaptation gain: rate: expected a positive number, got 'a'"),
    ],
)
def test_settings_that_cannot_be_are_refused(make: Callable[[], object], says: str) -> None:
    with pytest.raises(InputError, match=says) as refused:
        make()
    assert "\n" not in str(refused.value)


def test_motors_whose_numbers_are_not_finite_are_refused() -> None:
    with pytest.raises(NonFiniteError, match="drives: positions: expected finite numbers, got nan"):
        drives().position([0.0, np.nan])


def test_drives_take_lists_and_turn_back_what_they_turn() -> None:
    p, v, tau = np.random.default_rng(0).normal(size=(3, 5, 2))
    of_lists, T = drives(transmission=[[2.0, 0.0], [1.0, 4.0]], offsets=[0.5, 0.0]), drives().transmission
    np.testing.assert_allclose(of_lists.position((p - drives().offsets) @ T.T), p, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(of_lists.velocity(v @ T.T), v, rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(of_lists.torque(tau.tolist()), tau @ T)


def test_a_joint_that_nothing_was_measured_of_has_no_relative_error_unless_it_is_without_one() -> None:
    found = replace(validation(np.zeros((3, 3))), measured=np.zeros((3, 3)), predicted=np.eye(3) * [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(found.joint_relative_errors, [0.0, np.inf, np.inf])
    assert found.relative_error == np.inf
    assert replace(found, predicted=found.measured).relative_error == 0.0


def test_samples_may_be_counted_by_numpy() -> None:
    assert essential_space(puma(), samples=cast(Any, np.int64(61))).certificate.samples == 61


def test_the_arrays_of_a_reduction_are_read_only() -> None:
    found = reduce(space(), puma(), components=2)
    assert not any(array.flags.writeable for array in (found.components, found.weights, found.percent_errors))


@pytest.mark.parametrize("value", [0.0, 0.1, -1e3])
def test_an_error_that_never_changes_goes_with_none_of_its_later_ones(value: float) -> None:
    errors = np.random.default_rng(0).normal(size=(20, 2))
    errors[:, 0] = value
    found = validation(errors).autocorrelation(5)
    np.testing.assert_array_equal(found[:, 0], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert np.isfinite(found).all()
    assert found[0, 1] == 1.0
    assert found[1:, 1].all()


def test_the_adaptation_gain_is_in_proportion_to_its_rate() -> None:
    once, twice = (identified().adaptation_gain(rate) for rate in (0.3, 0.6))
    np.testing.assert_allclose(twice, 2.0 * once, rtol=1e-15)


def test_a_mechanism_whose_constraints_take_nothing_away_can_be_lifted() -> None:
    model = ReducedModel.full(constrained(two_link(), Constraints()))
    assert nearest_consistent(model, model.fundamental_parameters).is_feasible


def test_a_file_in_the_place_of_the_figures_is_said(tmp_path: Path) -> None:
    (tmp_path / "figures").write_text("")
    with pytest.raises(FileError, match=r"figures: the folder cannot be made \(file exists\)"):
        write_artifacts(tmp_path, compared_runs(two_link(), runs()))
    assert [path.name for path in tmp_path.iterdir()] == ["figures"]
