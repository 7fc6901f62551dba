"""What Python imports first in processes that tests start: it has one module loaded from code that was changed."""

import marshal
import os
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType

TARGET, _, CHANGED = os.environ.get("CHANGED_MODULE", "").partition(os.pathsep)


def _get_code(self: SourceFileLoader, name: str, original=SourceFileLoader.get_code) -> CodeType | None:  # type: ignore[no-untyped-def]
    if os.path.realpath(self.path) != TARGET:
        return original(self, name)
    code: CodeType = marshal.loads(Path(CHANGED).read_bytes())
    return code


SourceFileLoader.get_code = _get_code  # type: ignore[method-assign]
