"""Saved estimates: what was learnt can be started from."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adaptctl.control import SlotineLi, load_estimate, save_estimate
from adaptctl.description import Pose
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import FileError, InputError
from adaptctl.identifiability import ReducedModel


@pytest.fixture(scope="module")
def model() -> ReducedModel:
    arm = load("semi_direct_drive")
    return ReducedModel(arm)


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


def test_an_estimate_of_another_geometry_is_refused_until_told(model: ReducedModel, tmp_path: Path) -> None:
    """Of other lengths, with the same names of parameters, its numbers mean something else."""
    description = model.mechanism.description
    first = replace(description.links[1], parent_to_joint=Pose(np.eye(3), np.array([0.9, 0.0, 0.0])))
    longer = Mechanism(replace(description, links=(description.links[0], first, *description.links[2:])))
    other, path = ReducedModel.full(longer), tmp_path / "estimate.json"
    save_estimate(path, ReducedModel.full(model.mechanism), np.arange(50.0))
    with pytest.raises(FileError, match="whose geometry, gravity or names are other than those of") as refused:
        load_estimate(path, other)
    accept(path, str(refused.value))
    np.testing.assert_array_equal(load_estimate(path, other), np.arange(50.0))


def test_an_edited_estimate_is_refused_until_told(model: ReducedModel, tmp_path: Path) -> None:
    path = tmp_path / "estimate.json"
    save_estimate(path, model, np.arange(26.0))
    path.write_text(path.read_text().replace(": 25.0", ": 26.0"))
    with pytest.raises(FileError, match="the parameters were changed; to accept them, write ") as refused:
        load_estimate(path, model)
    accept(path, str(refused.value))
    assert load_estimate(path, model)[-1] == 26.0


def accept(path: Path, message: str) -> None:
    """Write the entry that a message gives into a file."""
    name, value = re.findall(r'write "(\w+)": "(\w+)"$', message)[0]
    path.write_text(re.sub(f'"{name}": "\\w+"', f'"{name}": "{value}"', path.read_text()))


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
    content = {"schema": "adaptctl/estimate/2", "mechanism": "x", "geometry_sha256": "", "sha256": ""}
    (tmp_path / "text.json").write_text(json.dumps(content | {"parameters": {"a": "b"}}))
    with pytest.raises(FileError, match=r"parameters"):
        load_estimate(tmp_path / "text.json", model)
