"""Methods by which a null space is found, and what is made of geometry that is nearly special."""

from __future__ import annotations

from typing import Literal

Method = Literal["automatic", "svd", "transfers"]

Near = Literal["refuse", "as_is"]
