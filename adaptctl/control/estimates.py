"""Files of parameter estimates: what one controller learnt, another may start from."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.errors import FileError, printable
from adaptctl.files import read_json, write_json
from adaptctl.identifiability import ReducedModel

SCHEMA = "adaptctl/estimate/1"


class _Saved(msgspec.Struct, forbid_unknown_fields=True):
    schema: Literal["adaptctl/estimate/1"]
    mechanism: str
    parameters: dict[str, float]


def save_estimate(path: str | Path, model: ReducedModel, estimate: ArrayLike) -> None:
    """Write an `estimate` (k,) of the `model`'s k parameters, in their SI units, as a JSON file at `path`, each number
    under its parameter's name. A file that exists is replaced.

    Raises `InputError` for an estimate of a wrong shape or not finite, `FileError` for a `path` that is no path of a
    file, and where the file cannot be written.
    """
    _require_path(path)
    values = frozen_array(estimate, (len(model.names),), "estimate")
    parameters = dict(zip(model.names, values.tolist(), strict=True))
    write_json(path, {"schema": SCHEMA, "mechanism": model.mechanism.name, "parameters": parameters})


def load_estimate(path: str | Path, model: ReducedModel) -> Array:
    """The estimate (k,), in SI units, that `save_estimate` wrote at `path`, in the order of the `model`'s k parameters,
    whatever their order in the file.

    Raises `FileError` for a `path` that is no path of a file, and for a file that cannot be read, is no such estimate,
    has a number that is not finite, or has names of parameters other than the model's. The mechanism's name in the file
    is not compared.
    """
    _require_path(path)
    saved = read_json(path, _Saved).parameters
    missing = [name for name in model.names if name not in saved]
    foreign = [name for name in saved if name not in model.names]
    if missing or foreign:
        wrong = f"{missing[0]!r} is missing" if missing else f"{foreign[0]!r} is not among them"
        raise FileError(f"{path}: the parameters are not the {len(model.names)} of {model.mechanism.name}: {wrong}")
    return np.array([saved[name] for name in model.names])


def _require_path(path: object) -> None:
    if not isinstance(path, str | os.PathLike) or "\0" in str(path):
        raise FileError(f"path: expected the path of a file, got {printable(repr(path))}")
