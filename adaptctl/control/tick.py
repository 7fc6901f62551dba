"""One tick of a control law, and the check of what it returns."""

from __future__ import annotations

from typing import Any

from adaptctl.control.memory import leaves
from adaptctl.errors import InputError, TraceError
from adaptctl.scalars import Column


def ticked(law: Any, *given: Any) -> Any:
    """The torque and the next internal state, as the method `law` of the controller `law` returns them: the value of
    `law.law(*given)`, not checked. `given` are the arguments: positions, velocities, reference point, internal state.
    Raises `TraceError`, which names the controller, where the method applies a NumPy function to a `Column`, a vector
    of scalars of any kind, which takes none; other errors go through."""
    try:
        return law.law(*given)
    except TypeError as error:
        if "operand 'Column' does not support ufuncs" not in str(error):
            raise
        raise TraceError(
            f"{type(law).__name__}.law: NumPy's functions take no column: apply those of adaptctl.scalars to each of "
            "its scalars, as in Column(tanh(x) for x in e)"
        ) from error


def require_tick(law: Any, returned: Any) -> tuple[Column, Any]:
    """The torque, a `Column` (vector of scalars) of length r for r joints, and the internal state in `returned`, the
    value that the method `law` of the controller `law` returned. Raises `InputError` unless `returned` is a tuple of
    such a column and an internal state: a named tuple of as many columns, each as long, as the controller's method
    `start` gives."""
    what = f"{type(law).__name__}.law: expected it to return the torque, a Column of {law.dof}, and the memory after it"
    if not isinstance(returned, tuple) or len(returned) != 2:
        raise InputError(f"{what}, got {type(returned).__name__}")
    torque, after = returned
    if not isinstance(torque, Column) or len(torque) != law.dof:
        got = f"a column of {len(torque)}" if isinstance(torque, Column) else type(torque).__name__
        raise InputError(f"{what}, got {got} for the torque")
    sizes = [len(part) for part in leaves(after)] if isinstance(after, tuple) else None
    if sizes != list(law._memory_sizes.values()):
        raise InputError(f"{what}, got another memory than `start` gives: {after!r:.80}")
    return torque, after
