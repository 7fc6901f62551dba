"""References, places and choices of an export that cannot be: refused by name, and nothing is written."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from every_law import LAWS

import adaptctl
from adaptctl.codegen.c_program import _runs
from adaptctl.codegen.initialisation import _computed
from adaptctl.control import ReferencePoint, Sinusoids
from adaptctl.errors import FileError, InputError, NonFiniteError

TWO = Sinusoids(np.zeros(2), np.full(2, 0.1), np.full(2, 0.2))


def held(value: float) -> Any:
    return lambda t: ReferencePoint(*(np.full((*np.shape(t), 3), value),) * 3)


BAD_REFERENCES: dict[str, tuple[Any, type[InputError], str]] = {
    "number": (3, InputError, "reference: expected a function of time, got 3"),
    "array": (np.zeros(3), InputError, "reference: expected a function of time, got array"),
    "two joints": (TWO, InputError, r"reference: p: expected shape \(\.\.\., 3\), got \(2, 2\)"),
    "no point": (lambda t: None, InputError, r"expected it to return ReferencePoint\(p, v, a\), .*got a NoneType"),
    "one time": (lambda t: ReferencePoint(*(np.zeros(3),) * 3), InputError, "reference: p: expected times"),
    "NaN": (held(np.nan), NonFiniteError, "reference: p: expected finite numbers, got nan"),
}


@pytest.mark.parametrize("check", [False, True])
@pytest.mark.parametrize("case", BAD_REFERENCES)
def test_wrong_references_are_refused(case: str, check: bool, tmp_path: Path) -> None:
    reference, kind, message = BAD_REFERENCES[case]
    with pytest.raises(kind, match=message):
        adaptctl.export(
            LAWS["gradient"], tmp_path / "out", without_safety_filter=True, check=check, reference=reference
        )
    assert list(tmp_path.iterdir()) == []


def test_a_reference_that_fits_is_followed(tmp_path: Path) -> None:
    done = adaptctl.export(LAWS["gradient"], tmp_path / "out", without_safety_filter=True, reference=held(0.1))
    assert done.manifest["vectors"] == 100


@pytest.mark.parametrize("directory", [None, 3, ["a"], b"a", "a\0b", "a" * 300], ids=lambda given: repr(given)[:8])
def test_what_is_no_path_is_refused(directory: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileError, match="directory: expected the path of a folder, got "):
        adaptctl.export(LAWS["guarded"], directory)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["scalar", "language"])
@pytest.mark.parametrize("wrong", [np.zeros(2), ["double"], 3, None], ids=repr)
def test_choices_are_texts(name: str, wrong: Any, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"{name}: expected (double or float|c or wasm), got "):
        adaptctl.export(LAWS["guarded"], tmp_path / "out", **{name: wrong})


def test_memory_of_other_laws_that_depends_on_positions_is_named() -> None:
    other: Any = SimpleNamespace(innermost=object(), memory=[SimpleNamespace(name="filtered", size=2)])
    with pytest.raises(InputError, match="object: the initial state filtered depends on the position"):
        _computed(other, (0,))


def test_numbers_side_by_side_are_put_back_at_once() -> None:
    signature: Any = SimpleNamespace(place="out{}[{}]".format, given="in{}[{}]".format)
    back = [((0, 1), (2, 1)), ((0, 2), (2, 2)), ((1, 3), (2, 3)), ((1, 5), (2, 4))]
    found = list(_runs(back, signature))
    assert found == [("out0[1]", "in2[1]", 2), ("out1[3]", "in2[3]", 1), ("out1[5]", "in2[4]", 1)]
