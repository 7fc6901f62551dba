"""Results kept for other processes: equal to what is computed, and computed anew where anything has changed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import adaptctl
from adaptctl import ReducedModel, essential_space, fundamental_basis, load
from adaptctl.compilation import object_cache as result_cache
from adaptctl.compilation.object_cache import SUFFIX, kept, source_state
from adaptctl.control import sampling_ratio
from adaptctl.errors import InputError, RankError
from adaptctl.identifiability import Constraints, constrained
from adaptctl.identifiability.essential_space import EssentialSpace
from adaptctl.sweeps.rows import interned


class Found(NamedTuple):
    numbers: list[float]
    name: str


class Computation:
    """A computation that counts how often it is made."""

    def __init__(self, result: Found) -> None:
        self.result, self.times = result, 0

    def __call__(self) -> Found:
        self.times += 1
        return self.result


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, in use by a process that has kept nothing yet."""
    monkeypatch.setenv("ADAPTCTL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(result_cache, "_left", iter(range(result_cache.MAX_RESULTS_IN_PROCESS)))
    return tmp_path / "cache"


def test_equal_inputs_are_computed_once(folder: Path) -> None:
    once = Computation(Found([0.1], "x"))
    for inputs in ([1.0, "a"], [1.0, "a"], [2.0, "a"], [1.0, "b"], [1.0, "a"]):
        assert kept("test", inputs, Found, once) == once.result
    assert once.times == 3
    kept("another", [1.0, "a"], Found, once)
    assert once.times == 4


@given(numbers=st.lists(st.floats(allow_nan=False, allow_infinity=False)), name=st.text(max_size=8))
def test_what_comes_back_is_the_same_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float], name: str
) -> None:
    once = Computation(Found(numbers, name))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ADAPTCTL_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(result_cache, "_left", iter(range(result_cache.MAX_RESULTS_IN_PROCESS)))
        kept("test", 0, Found, once)
        again = kept("test", 0, Found, once)
    assert once.times == 1
    assert again.name == name
    np.testing.assert_array_equal(np.array(again.numbers).view(np.int64), np.array(numbers).view(np.int64))


def test_other_source_code_computes_anew(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    once = Computation(Found([], ""))
    kept("test", 0, Found, once)
    changed = source_state()[::-1]
    monkeypatch.setattr(result_cache, "source_state", lambda: changed)
    kept("test", 0, Found, once)
    assert once.times == 2


def test_a_change_of_a_source_file_is_seen(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    paths = [tmp_path / "one.py", tmp_path / "inner" / "two.py"]
    for path in paths:
        path.write_text("x = 1\n")
    before = sorted(result_cache.source_files(str(tmp_path)))
    assert [Path(path) for path, _, _ in before] == sorted(paths)
    os.utime(paths[1], ns=(1, 1))
    assert sorted(result_cache.source_files(str(tmp_path))) != before


def test_every_module_of_the_library_counts() -> None:
    root = Path(adaptctl.__file__).parent
    found = {Path(path) for path, _, _ in result_cache.source_files(str(root))}
    assert found == set(root.glob("**/*.py")) | set((root / "envs").glob("**/*.py")) | set(
        (root / "experiments").glob("**/*.py")
    )


@pytest.mark.parametrize("damage", [lambda data: data[:-1], lambda data: b"{" + data, lambda data: b""])
def test_damaged_results_are_computed_anew(folder: Path, damage: object) -> None:
    once = Computation(Found([1.0], "x"))
    kept("test", 0, Found, once)
    (path,) = folder.iterdir()
    assert path.suffix == SUFFIX
    path.write_bytes(damage(path.read_bytes()))  # type: ignore[operator]
    assert kept("test", 0, Found, once) == once.result
    assert once.times == 2


def test_what_is_of_another_kind_is_computed_anew(folder: Path) -> None:
    kept("test", 0, list[float], lambda: [1.0])
    assert kept("test", 0, Found, Computation(Found([2.0], "y"))) == Found([2.0], "y")


def test_infinity_is_no_json_and_is_computed_anew(folder: Path) -> None:
    once = Computation(Found([float("inf")], ""))
    assert kept("test", 0, Found, once) == kept("test", 0, Found, once) == once.result
    assert once.times == 2


@pytest.mark.parametrize(
    "variable", ["OPENBLAS_CORETYPE", "OPENBLAS_NUM_THREADS", "ADAPTCTL_PROCESSOR", "ADAPTCTL_OPTIMIZATION"]
)
def test_other_arithmetic_computes_anew(folder: Path, monkeypatch: pytest.MonkeyPatch, variable: str) -> None:
    once = Computation(Found([], ""))
    for setting, times in (("1", 1), ("2", 2), ("1", 2)):
        monkeypatch.setenv(variable, setting)
        kept("test", 0, Found, once)
        assert once.times == times


def test_errors_are_not_kept(folder: Path) -> None:
    def fails() -> Found:
        raise InputError("no")

    for _ in range(2):
        with pytest.raises(InputError):
            kept("test", 0, Found, fails)
    assert not folder.exists()


def test_a_sweep_does_not_fill_the_folder(folder: Path) -> None:
    for k in range(3 * result_cache.MAX_RESULTS_IN_PROCESS):
        kept("test", k, int, lambda k=k: k)  # type: ignore[misc]
    assert len(list(folder.iterdir())) == result_cache.MAX_RESULTS_IN_PROCESS


def test_nothing_is_kept_where_the_cache_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTCTL_CACHE", "off")
    once = Computation(Found([], ""))
    kept("test", 0, Found, once), kept("test", 0, Found, once)
    assert once.times == 2


# What the library keeps


def same(one: EssentialSpace, other: EssentialSpace) -> None:
    assert one.certificate == other.certificate
    assert (one.rank, one.states) == (other.rank, other.states)
    for name in ("scales", "null_basis", "scaled_null_basis", "basis", "singular_values"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("robot", ["puma560_measured", "semi_direct_drive"])
def test_a_kept_certificate_and_basis_are_those_that_are_computed(
    folder: Path, robot: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    spaces = [essential_space(load(robot)) for _ in range(2)]
    bases = [fundamental_basis(space) for space in spaces]
    assert len(list(folder.iterdir())) >= 2
    assert "found" in vars(spaces[0].search)
    assert "found" not in vars(spaces[1].search)  # which was read
    monkeypatch.setenv("ADAPTCTL_CACHE", "off")
    spaces.append(essential_space(load(robot)))
    bases.append(fundamental_basis(spaces[-1]))
    for space, basis in zip(spaces[:2], bases[:2], strict=True):
        same(space, spaces[2])
        assert (basis.columns, basis.kept_despite_priority, basis.gap) == (
            bases[2].columns,
            bases[2].kept_despite_priority,
            bases[2].gap,
        )
        np.testing.assert_array_equal(basis.regrouping, bases[2].regrouping)
        np.testing.assert_array_equal(basis.scales, bases[2].scales)


def test_other_settings_are_other_results(folder: Path) -> None:
    arm = load("puma560_measured")
    assert essential_space(arm).certificate != essential_space(arm, seed=1).certificate
    space = essential_space(arm)
    assert fundamental_basis(space).columns == fundamental_basis(space, tolerance=2e-3).columns
    with pytest.raises(InputError, match="method"):
        essential_space(arm, method="guess")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="as_written"):
        essential_space(arm, as_written="far")  # type: ignore[arg-type]
    with pytest.raises((InputError, RankError)):
        fundamental_basis(space, tolerance=1.0)


def test_a_certificate_is_of_its_constraints(folder: Path) -> None:
    """Two mechanisms of one description: what matters is known of the one, and what does not matter of the other."""
    arm = load("semi_direct_drive")
    own = dict(zip(arm.parameter_names, arm.inertial_parameters.tolist(), strict=True))
    known = [constrained(arm, Constraints({name: own[name]})) for name in ("link1.m", "link5.I_xy")]
    assert known[0].description == known[1].description
    assert [essential_space(one, prove=False).rank for one in known] == [26, 25]
    assert [fundamental_basis(essential_space(one, prove=False)).rank for one in known] == [26, 25]
    assert interned(known[0]) is known[0] is not interned(known[1])


def test_a_kept_hold_number_is_the_one_that_is_found(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    damping = [90.0, 150.0, 70.0, 20.0, 16.0, 18.0]
    found = [sampling_ratio(load("puma560_measured"), damping, 1e-3, 8.0) for _ in range(2)]
    monkeypatch.setenv("ADAPTCTL_CACHE", "off")
    found.append(sampling_ratio(load("puma560_measured"), damping, 1e-3, 8.0))
    assert len({(each.value, each.joint, tuple(each.p)) for each in found}) == 1
    assert not any(each.p.flags.writeable for each in found)


def test_a_wrong_basis_is_refused_however_often(folder: Path) -> None:
    from dataclasses import replace

    arm = load("puma560_measured")
    basis = fundamental_basis(essential_space(arm))
    ReducedModel(arm, basis)
    wrong = basis.regrouping.copy()
    i, j = np.argwhere((wrong != 0.0) & (wrong != 1.0))[0]
    wrong[i, j] *= 1.5
    for _ in range(2):
        with pytest.raises(InputError, match="wrong or damaged"):
            ReducedModel(arm, replace(basis, regrouping=wrong))


def test_a_second_process_proves_nothing(tmp_path: Path) -> None:
    """It imports neither the proof nor what samples states, and finds the same basis."""
    program = (
        "import sys, adaptctl\n"
        "arm = adaptctl.load('puma560_measured')\n"
        "model = adaptctl.ReducedModel(arm)\n"
        "adaptctl.SlotineLi(model, 8.0, [0.2, 0.3, 0.15, 0.04, 0.03, 0.04])\n"
        "heavy = ('identifiability.proof', 'identifiability.sampling', 'identifiability.certification')\n"
        "found = [m for m in sys.modules if m.removeprefix('adaptctl.').startswith(heavy)]\n"
        "print(model.basis.columns, found)"
    )
    environment = os.environ | {"ADAPTCTL_CACHE": str(tmp_path)}
    said = [
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", program], env=environment, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]
    assert "identifiability.proof" in said[0]
    assert said[1].strip().endswith("[]")
    assert said[0].partition(")")[0] == said[1].partition(")")[0]
