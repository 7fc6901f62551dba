"""Episodes of controllers as data sets of Minari."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium

from adaptctl.arrays import whole_count
from adaptctl.control import Controller
from adaptctl.errors import InputError
from adaptctl.optional_packages import needed
from adaptctl.simulation.rollout import rollout


def write_minari(
    dataset_id: str,
    env: gymnasium.Env[Any, Any],
    controllers: Mapping[str, Controller[Any]],
    *,
    episodes: int = 1,
    seed: int = 0,
    author: str = "",
) -> Any:
    """
    Write episodes of controllers, such as an expert and a learning one, as a data set of Minari.

    Parameters
    ----------
    dataset_id : str
        Name for Minari, such as ``"adaptctl/puma560/mixed-v0"``; its folder is set by ``MINARI_DATASETS_PATH``.
    env : gymnasium.Env
        Environment that the controllers run in, as in `rollout`.
    controllers : mapping of str to Controller
        Controllers by name. Their episodes follow each other in this order, and the names are the data set's algorithm.
    episodes : int, default 1
        Number of episodes of each controller. One is enough for a fixed reference.
    seed : int, default 0
        Seed of the first episode; the next ones count up, the same for all controllers.
    author : str, default ""
        Author for the data set's description.

    Returns
    -------
    minari.MinariDataset
        The data set. Observations, actions and rewards are those of the environment; times are not stored.

    Raises
    ------
    InputError
        If there is no controller, or a number is bad.
    ValueError
        If Minari refuses the name, or has a data set of it.
    MissingExtraError
        If Minari is not installed (extra ``data``).

    Examples
    --------
    >>> from adaptctl.envs import write_minari
    >>> write_minari("adaptctl/two_link/none-v0", env, {})
    Traceback (most recent call last):
    adaptctl.errors.InputError: controllers: expected at least one
    """
    count, first = whole_count(episodes, "episodes", 1), whole_count(seed, "seed")
    if not controllers:
        raise InputError("controllers: expected at least one")
    with needed("a data set of Minari"):
        from minari import DataCollector
    collector = DataCollector(env, data_format="arrow")
    for controller in controllers.values():
        for k in range(first, first + count):
            rollout(collector, controller, seed=k)
    return collector.create_dataset(
        dataset_id=dataset_id, algorithm_name=", ".join(controllers), author=author or None, requirements=["adaptctl"]
    )
