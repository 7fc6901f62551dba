"""Former names: a message offers the one that replaces each."""

from __future__ import annotations

from pathlib import Path

import pytest

import adaptctl
from adaptctl.cli.main import main
from adaptctl.errors import FileError
from adaptctl.experiments.laws import Laws
from adaptctl.renamed import RENAMED, new_name
from adaptctl.sweeps.study import SweepStudy

RUN = ("experiment", "run")


@pytest.mark.parametrize(
    ("line", "new"),
    [
        (("tune", "puma560", "--hold", "1"), "--sampling-ratio"),
        (("gains", "puma560", "--period", "1"), "--control-period"),
        (("basis", "puma560", "--as-is"), "--as-written"),
        (("tune", "puma560", "--no-snap"), "--as-written"),
        (("excite", "puma560", "--rate", "1"), "--sample-rate"),
        (("design", "puma560", "--share", "1"), "--mass-ratio"),
        ((*RUN, "adaptive", "--rate", "1"), "--adaptation-ratio"),
        ((*RUN, "laws", "--rate", "1"), "--gain-scale"),
        ((*RUN, "laws", "--halt", "1"), "--reference-stop"),
        ((*RUN, "task-space", "--stiffness", "1"), "--damping-scale"),
    ],
)
def test_a_former_flag_is_refused_with_the_new_one(
    line: tuple[str, ...], new: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line) == 2
    assert f"Did you mean {new}?" in capsys.readouterr().err


@pytest.mark.parametrize("line", [("basis", "puma560"), ("excite", "puma560"), (*RUN, "adaptive")])
def test_what_is_the_default_now_is_said(line: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert main((*line, "--snap")) == 2
    assert "Unknown option: --snap, now the default; --as-written is its opposite" in capsys.readouterr().err


def test_a_former_experiment_is_refused_with_the_command_that_replaced_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main((*RUN, "friction", "--seed", "1")) == 2
    assert "replaced by: adaptctl experiment run laws --disturbance friction" in capsys.readouterr().err


def test_a_former_setting_is_refused_with_the_new_one() -> None:
    with pytest.raises(TypeError, match=r"no setting 'halt' \(did you mean 'reference_stop'\?\)"):
        Laws(halt=1.0)


def test_a_former_name_is_refused_with_the_new_one() -> None:
    with pytest.raises(AttributeError, match=r"'Guarded' \(did you mean 'SafetyFilter'\?\)"):
        _ = adaptctl.control.Guarded  # type: ignore[attr-defined]


def test_a_file_of_a_former_schema_is_refused_with_the_page(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text('schema = "adaptctl/study/1"\nexperiment = "laws"\n[settings]\nhalt = 1\n')
    with pytest.raises(FileError, match=r"expected one of 'adaptctl/study/2'\. docs/renamed\.md tells what"):
        SweepStudy.named(str(path), {})
    path.write_text('schema = "adaptctl/stud"\nexperiment = "laws"\n[settings]\nseed = 1\n')
    with pytest.raises(FileError, match="'adaptctl/stud'") as caught:
        SweepStudy.named(str(path), {})
    assert "renamed.md" not in str(caught.value)


def test_a_new_name_is_one_of_those_known() -> None:
    assert new_name("rate", {"gain_scale"}) == "gain_scale"
    assert new_name("rate", {"bandwidth"}) is None
    assert not {new for names in RENAMED.values() for new in names} & RENAMED.keys()
    assert Path("docs/renamed.md").is_file()
