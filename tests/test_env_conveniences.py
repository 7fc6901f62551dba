"""Gymnasium's conveniences: a live view as the mode "human", videos, thresholds, data sets of Minari."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from nightly import mostly_at_night
from rerun.chunk import RrdReader

import adaptctl
from adaptctl.control import ComputedTorque
from adaptctl.envs import TrackingEnv, VectorTrackingEnv, VideoRecorder, baselines, write_minari
from adaptctl.errors import InputError, MissingExtraError, NotFoundError
from adaptctl.recording.live import streaming
from adaptctl.simulation import rollout

PERIOD, STEPS = 1e-2, 12
LEARNERS = Path(__file__).parent.parent / "docs" / "learners.md"


@pytest.fixture(scope="module")
def arm() -> adaptctl.Mechanism:
    return adaptctl.load("two_link")


def tracking(arm: adaptctl.Mechanism, mode: str | None = None) -> gymnasium.Env[Any, Any]:
    settings: dict[str, Any] = {"reference": 1, "control_period": PERIOD, "duration": STEPS * PERIOD}
    return gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", robot=arm, render_mode=mode, **settings)


def test_the_mode_human_shows_each_step_in_the_live_view(arm: adaptctl.Mechanism, tmp_path: Path) -> None:
    with streaming(str(tmp_path / "live.rrd")):
        env = tracking(arm, "human")
        env.reset(seed=0)
        for _ in range(STEPS):
            env.step(np.zeros(2))
        assert env.render() is None
        env.close()
    chunks = RrdReader(tmp_path / "live.rrd").store().stream()
    torques = chunks.filter(content="/torque", components="Scalars:scalars", is_static=False)
    assert sum(len(chunk.to_record_batch()) for chunk in torques) == 1 + STEPS
    with pytest.raises(NotFoundError, match="unknown render mode 'human' of many arms; modes: rgb_array"):
        VectorTrackingEnv(2, robot=arm, render_mode="human")


class Clip:
    """Stand-in for moviepy's clip, which keeps what it is given."""

    made: list[tuple[int, float]] = []  # noqa: RUF012

    def __init__(self, frames: list[Any], fps: float) -> None:
        self.made.append((len(frames), fps))

    def write_videofile(self, path: str, **settings: Any) -> None:
        Path(path).write_bytes(b"mp4")


def test_a_video_has_frames_in_real_time(
    arm: adaptctl.Mechanism, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "moviepy", SimpleNamespace(ImageSequenceClip=Clip))  # type: ignore[arg-type]
    monkeypatch.setattr(Clip, "made", [])
    monkeypatch.setattr(TrackingEnv, "render", lambda self: np.zeros((480, 640, 3), dtype=np.uint8))
    env = VideoRecorder(tracking(arm, "rgb_array"), tmp_path / "new" / "videos", frame_rate=25.0)
    run = rollout(env, ComputedTorque(arm, 8.0), seed=0)
    env.reset(seed=1)
    env.close()
    assert len(run.time) == STEPS
    assert Clip.made == [(1 + STEPS // 4, pytest.approx(25.0)), (1, pytest.approx(25.0))]
    assert sorted(path.name for path in (tmp_path / "new" / "videos").iterdir()) == ["episode-0.mp4", "episode-1.mp4"]


def test_a_video_ends_where_an_episode_is_lost(
    arm: adaptctl.Mechanism, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "moviepy", SimpleNamespace(ImageSequenceClip=Clip))  # type: ignore[arg-type]
    monkeypatch.setattr(Clip, "made", [])
    monkeypatch.setattr(TrackingEnv, "render", lambda self: np.zeros((48, 64, 3), dtype=np.uint8))
    env = VideoRecorder(tracking(arm, "rgb_array"), tmp_path, frame_rate=1e3)
    monkeypatch.setattr(TrackingEnv, "step", lambda self, action: (action, -1.0, True, False, {}))
    env.reset(seed=0)
    env.step(np.zeros(2))
    assert [count for count, _ in Clip.made] == [2]


@pytest.mark.parametrize(("rate", "steps"), [(25.0, [0, 4, 8, 12]), (50.0, [0, 2, 4, 6, 8, 10, 12]), (1e3, range(13))])
def test_frames_are_of_the_first_state_and_each_that_is_due(
    arm: adaptctl.Mechanism, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rate: float, steps: Any
) -> None:
    shown: list[float] = []

    def clip(frames: list[Any], fps: float) -> Any:
        assert fps == pytest.approx(min(rate, 1.0 / PERIOD))
        shown.extend(float(frame) for frame in frames)
        return SimpleNamespace(write_videofile=lambda path, **settings: Path(path).touch())

    monkeypatch.setitem(sys.modules, "moviepy", SimpleNamespace(ImageSequenceClip=clip))  # type: ignore[arg-type]
    monkeypatch.setattr(TrackingEnv, "render", lambda env: np.array(env._episode.step))
    env = VideoRecorder(tracking(arm, "rgb_array"), tmp_path, frame_rate=rate)
    rollout(env, ComputedTorque(arm, 8.0), seed=0)
    assert shown == list(steps)


def test_videos_name_what_is_missing(arm: adaptctl.Mechanism, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "moviepy", None)
    with pytest.raises(MissingExtraError, match=r"a video needs moviepy: pip install 'adaptctl\[video\]'"):
        VideoRecorder(tracking(arm, "rgb_array"), tmp_path)
    with pytest.raises(InputError, match="cannot be recorded: it needs render_mode='rgb_array'"):
        VideoRecorder(tracking(arm), tmp_path)


def test_data_sets_have_each_controller_s_episodes(arm: adaptctl.Mechanism, monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[Any] = []

    class Collector(gymnasium.Wrapper[Any, Any, Any, Any]):
        def __init__(self, env: gymnasium.Env[Any, Any], data_format: str) -> None:
            super().__init__(env)

        def reset(self, **how: Any) -> Any:
            kept.append(how["seed"])
            return self.env.reset(**how)

        def create_dataset(self, **about: Any) -> Any:
            return about

    monkeypatch.setitem(sys.modules, "minari", SimpleNamespace(DataCollector=Collector))  # type: ignore[arg-type]
    laws = {"stiff": ComputedTorque(arm, 8.0), "soft": ComputedTorque(arm, 2.0)}
    about = write_minari("adaptctl/two_link/mixed-v0", tracking(arm), laws, episodes=2, seed=5)
    assert kept == [5, 6, 5, 6]
    assert (about["dataset_id"], about["algorithm_name"]) == ("adaptctl/two_link/mixed-v0", "stiff, soft")
    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(MissingExtraError, match=r"needs minari: pip install 'adaptctl\[data\]'"):
        write_minari("adaptctl/two_link/mixed-v0", tracking(arm), laws)


THRESHOLDS = "Puma560Tracking", "SemiDirectDriveTracking", "Puma560Learning"


@pytest.mark.parametrize("name", mostly_at_night(THRESHOLDS, "Puma560Learning"))
def test_thresholds_are_returns_of_the_law_that_knows_nothing(name: str) -> None:
    spec = gymnasium.spec(f"adaptctl/{name}-v0")
    assert f"−{-(spec.reward_threshold or 0.0)} for `{spec.id}`" in " ".join(LEARNERS.read_text("utf-8").split())
    found = baselines(gymnasium.make(spec))["Slotine-Li from zero estimates"]
    assert spec.reward_threshold is not None
    assert spec.reward_threshold < found < spec.reward_threshold + 0.1
