"""What is put into the folder of an identification, by scripted robots and few numbers."""

from __future__ import annotations

import hashlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.errors import AdaptctlError
from adaptctl.identification import Validation, files
from adaptctl.identification.files import _logs, _motion, _payloads, write_identification


def test_logs_are_known_by_their_hashes_if_they_are_files(tmp_path: Path) -> None:
    (path := tmp_path / "a.csv").write_bytes(b"1,2\n")
    found = _logs([str(path), "a run", str(path)])
    assert found == {str(path): hashlib.sha256(b"1,2\n").hexdigest(), "a run": None}


@pytest.mark.parametrize(("count", "names"), [(0, []), (1, ["payload"]), (2, ["payload_1", "payload_2"])])
def test_payloads_are_numbered_if_there_are_several(count: int, names: list[str]) -> None:
    found: Any = SimpleNamespace(payloads=[SimpleNamespace(urdf=lambda name: f"<{name}>")] * count)
    assert list(_payloads(found)) == [(f"{name}.urdf", f"<{name}>") for name in names]


def test_the_motion_of_all_logs_is_shown_by_rising_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each the samples that its smoothed positions are of."""
    monkeypatch.setattr(files, "MAX_RECORDED_SAMPLES", 100)

    def motion(first: float, position: list[float]) -> Any:
        time = first + 0.1 * np.arange(9.0)
        own = SimpleNamespace(log=SimpleNamespace(time=time), first=1, every=3)
        own.position = np.array(position)[:, None]
        return own

    found: Any = SimpleNamespace(motions=[motion(5.0, [1.0, 2.0]), motion(0.0, [3.0, 4.0, 5.0])])
    time, position = _motion(found)
    np.testing.assert_allclose(time, [0.1, 0.4, 0.7, 5.1, 5.4])
    np.testing.assert_array_equal(position[:, 0], [3.0, 4.0, 5.0, 1.0, 2.0])


@pytest.mark.parametrize("figures", [False, True])
@pytest.mark.parametrize(("off", "refused"), [(0.9e-6, False), (2.2e-6, True)])
def test_the_robot_that_is_written_predicts_as_the_estimate_does(
    off: float, refused: bool, figures: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To a millionth of the torques; else nothing is written."""
    measured, predicted = np.full((4, 1), 2.0), np.array([[2.0], [0.0], [1.0], [2.0]])
    given = Validation("a", 9.0, np.arange(4.0), measured, predicted)
    again = Validation("a", 9.0, np.arange(4.0), measured, predicted + np.array([[0.0], [2.0 * off], [0.0], [0.0]]))
    seen: dict[str, Any] = {}

    def robots(folder: Path, *_: Any) -> Any:
        (folder / "robot.toml").write_text("a robot")
        yield SimpleNamespace(name="robot.toml", validation=again)

    def write(folder: Path, content: str, tables: Any, record: Any, figures: bool) -> None:
        for name, save in tables.items():
            if name == "robot.toml":
                save(folder / name)
        seen.update(tables=list(tables), content=content, figures=figures)

    shown = SimpleNamespace(write=write, drawings=["a drawing"])
    monkeypatch.setattr(files, "write_robots", robots)
    monkeypatch.setattr(files, "replace", lambda found, validation: SimpleNamespace(validation=validation, payloads=()))
    monkeypatch.setattr(files, "report", lambda found, written, figures: shown)
    monkeypatch.setattr(files, "summary", lambda found, written: "the summary")
    monkeypatch.setattr(files, "write_figures", lambda folder, drawings: seen.update(drawn=(folder, drawings)))
    found: Any = SimpleNamespace(validation=given)
    if refused:
        with pytest.raises(AdaptctlError, match=r"robot\.toml: predicts other torques than the estimate"):
            write_identification(tmp_path, found, figures=figures)
        assert not list(tmp_path.iterdir())
        return
    write_identification(tmp_path, found, figures=figures)
    assert (tmp_path / "robot.toml").read_text() == "a robot"
    assert (seen["tables"], seen["content"]) == (["robot.toml", "estimates.json", "validation.parquet"], "the summary")
    assert seen["figures"] is False
    assert seen.get("drawn") == ((tmp_path / "figures", ["a drawing"]) if figures else None)
