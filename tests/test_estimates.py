"""Saved estimates: what was learnt can be started from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adaptctl.control import SlotineLi, load_estimate, save_estimate
from adaptctl.dynamics import load
from adaptctl.errors import FileError, InputError
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis


@pytest.fixture(scope="module")
def model() -> ReducedModel:
    arm = load("semi_direct_drive")
    return ReducedModel(arm, fundamental_basis(essential_space(arm)))


def test_a_controller_starts_from_what_was_saved(model: ReducedModel, tmp_path: Path) -> None:
    learnt = np.random.default_rng(0).normal(size=26)
    save_estimate(tmp_path / "estimate.json", model, learnt)
    loaded = load_estimate(tmp_path / "estimate.json", model)
    np.testing.assert_array_equal(loaded, learnt)
    law = SlotineLi(model, 8.0, 60.0, initial=loaded)
    np.testing.assert_array_equal(law.init(np.array([0.0, -1.57, -3.14]), np.zeros(3)).estimate, learnt)


def test_estimates_of_other_parameters_are_refused(model: ReducedModel, tmp_path: Path) -> None:
    full = ReducedModel.full(model.mechanism)
    save_estimate(tmp_path / "all.json", full, np.zeros(50))
    with pytest.raises(
        FileError, match=r"expected the 26 parameters of semi_direct_drive: 'link1\.m' is not one of them"
    ):
        load_estimate(tmp_path / "all.json", model)
    save_estimate(tmp_path / "few.json", model, np.zeros(26))
    with pytest.raises(FileError, match=r"expected the 50 parameters of semi_direct_drive: 'link1\.m' is missing"):
        load_estimate(tmp_path / "few.json", full)


def test_bad_files_and_shapes_are_refused(model: ReducedModel, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"estimate: expected shape \(26,\), got \(25,\)"):
        save_estimate(tmp_path / "short.json", model, np.zeros(25))
    for path in (3, None, [tmp_path], b"a.json", "a\0.json"):
        with pytest.raises(FileError, match="path: expected the path of a file, got "):
            save_estimate(path, model, np.zeros(26))  # type: ignore[arg-type]
        with pytest.raises(FileError, match="path: expected the path of a file, got "):
            load_estimate(path, model)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="estimate: expected finite"):
        save_estimate(tmp_path / "nan.json", model, np.full(26, np.nan))
    assert not list(tmp_path.iterdir())
    (tmp_path / "text.json").write_text('{"schema": "adaptctl/estimate/1", "mechanism": "x", "parameters": {"a": "b"}}')
    with pytest.raises(FileError, match=r"parameters"):
        load_estimate(tmp_path / "text.json", model)
