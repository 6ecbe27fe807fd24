"""Files of upstream's cases, of which some may be missing."""

import contextlib
from collections.abc import Iterable
from typing import Any

import pytest

from tests.oracle import oracle_cases


def read_files(names: Iterable[str]) -> dict[str, Any]:
    """Return the cases of those files that are there, by name.

    For modules that replay several files: `oracle_cases` skips a module that asks for a
    file that is missing. Who asks for it in a test skips that test alone.
    """
    files = {}
    for name in names:
        with contextlib.suppress(pytest.skip.Exception):
            files[name] = oracle_cases(name)
    return files
