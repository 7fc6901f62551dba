"""Videos of episodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, positive_number
from adaptctl.errors import InputError
from adaptctl.files import replacing, validate_place
from adaptctl.folders import made_folder
from adaptctl.optional_packages import needed


class VideoRecorder(gymnasium.Wrapper[Array, Array, Array, Array]):
    """
    Wrapper that writes a video of each episode, in real time whatever the control period.

    Parameters
    ----------
    env : gymnasium.Env
        Environment with ``render_mode="rgb_array"`` and a `control_period` in s.
    folder : str or Path
        Folder of the files ``episode-0.mp4``, ``episode-1.mp4``, ..., which are replaced if they exist.
    frame_rate : float, default 25.0
        Frames per second. 25 look continuous; ``RecordVideo`` of Gymnasium keeps a frame of each step, 1,000 a second.

    Raises
    ------
    InputError
        If the environment has another mode or no control period, or the frame rate is no positive number.
    MissingExtraError
        If moviepy is not installed (extra ``video``).
    FileError
        If a file cannot be written.

    Examples
    --------
    >>> import gymnasium
    >>> from adaptctl.envs import VideoRecorder
    >>> shown = gymnasium.make(
    ...     "adaptctl.envs:adaptctl/Tracking-v0", robot=arm, reference=reference, duration=0.2, render_mode="rgb_array"
    ... )
    >>> VideoRecorder(shown, tmp, frame_rate=0.0)
    Traceback (most recent call last):
    adaptctl.errors.InputError: frame_rate: expected a positive number of frames per second, got 0.0
    """

    def __init__(self, env: gymnasium.Env[Any, Any], folder: str | Path, frame_rate: float = 25.0) -> None:
        super().__init__(env)
        rate = positive_number(frame_rate, "frame_rate: expected a positive number of frames per second")
        period = getattr(env.unwrapped, "control_period", None)
        if env.render_mode != "rgb_array" or not isinstance(period, int | float):
            raise InputError(f"{env}: cannot be recorded: it needs render_mode='rgb_array' and a control_period in s")
        with needed("a video"):
            import moviepy  # noqa: F401  # at once, and not at the end of the first episode
        self.folder, self.episodes = made_folder(Path(folder)), 0
        self._every = max(1, round(1.0 / (rate * period)))
        self._rate = 1.0 / (self._every * period)
        self._frames: list[NDArray[np.uint8]] = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """
        Write the video of an episode that was not at its end, and begin a new one.

        Parameters
        ----------
        seed : int, optional
            Seed passed to the environment. Default: none, its random numbers go on.
        options : dict, optional
            Options passed to the environment. Default: none.

        Returns
        -------
        tuple
            First observation (n,) and `info` of the environment.
        """
        self._write()
        begun = self.env.reset(seed=seed, options=options)
        self._steps = 0
        self._take()
        return begun

    def step(self, action: Array) -> tuple[Array, Any, bool, bool, dict[str, Any]]:
        """
        Advance the environment by a control period; write the video if the episode is over.

        Parameters
        ----------
        action : ndarray
            Action (a,) in the units of the environment.

        Returns
        -------
        tuple
            Observation (n,), reward, `terminated`, `truncated` and `info` of the environment.
        """
        told = self.env.step(action)
        self._steps += 1
        if self._steps % self._every == 0:
            self._take()
        if told[2] or told[3]:
            self._write()
        return told

    def close(self) -> None:
        """Write the video of an episode that was not at its end, and close the environment."""
        self._write()
        self.env.close()

    def _take(self) -> None:
        self._frames.append(np.asarray(self.env.render()))

    def _write(self) -> None:
        if not self._frames:
            return
        from moviepy import ImageSequenceClip

        frames, self._frames = self._frames, []
        with replacing(validate_place(self.folder / f"episode-{self.episodes}.mp4")) as beside:
            clip = ImageSequenceClip(frames, fps=self._rate)
            clip.write_videofile(str(beside), codec="libx264", audio=False, logger=None)
        self.episodes += 1
