"""Imports without the cyclic garbage collector."""

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def without_collection() -> Iterator[None]:
    """Let Python look for no garbage meanwhile, nor at once afterwards.

    It would look through all that is new after every 700 objects, and twice more before
    it takes it for old. `arm-drake sim doosan_a0912 --headless --duration 0.05` takes
    0.9 s of processor time, and 0.09 s more with the collector on; if what is new were
    not made old at the end, 0.07 s of these would come back. (`gc.callbacks` timed.)

    Where all was imported before, nothing is done: to count a million
    frozen objects takes Python 10 ms and more.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            is_much = gc.get_count()[0] > gc.get_threshold()[0]
            # Nobody else has frozen anything.
            if is_much and not gc.get_freeze_count():
                # Together they make all objects old, without looking at any of them.
                gc.freeze()
                gc.unfreeze()
            gc.enable()
