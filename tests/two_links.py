"""Two-link arm with other joints, for tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from adaptctl.control import Sinusoids
from adaptctl.description import Joint
from adaptctl.dynamics import Mechanism, load

ARM = load("two_link")
LIMITS = np.array([60.0, 25.0])
AT_REST = Sinusoids(np.zeros(2), np.zeros(2), np.ones(2))


def changed(joint: Callable[[Joint], Joint], only: int | None = None, **more: Any) -> Mechanism:
    """Two-link arm with other joints."""
    links = [replace(link, joint=joint(link.joint)) if only in (None, k) else link
             for k, link in enumerate(ARM.description.links)]  # fmt: skip
    return Mechanism(replace(ARM.description, links=tuple(links), **more))
