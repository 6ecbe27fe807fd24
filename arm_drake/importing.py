"""Imports without the search for garbage: what they make is much, and it stays."""

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def without_collection() -> Iterator[None]:
    """Let Python look for no garbage meanwhile, nor at once afterwards.

    It would look through all that is new after every 700 objects, and twice more before
    it takes it for old: a tenth of the time until a first simulation.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            if not gc.get_freeze_count():  # Nobody else has frozen anything.
                # Together they make all objects old, without looking at any of them.
                gc.freeze()
                gc.unfreeze()
            gc.enable()
