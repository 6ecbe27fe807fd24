"""Drake's log: warnings about a model, collected instead of printed."""

import contextlib
import logging
from collections.abc import Iterator

from pydrake.common import use_native_cpp_logging

# The logger that Drake's messages go through, unless its own logging is used.
_DRAKE = "drake"


class _Collector(logging.Handler):
    """Keeps messages."""

    def __init__(self, messages: list[str]) -> None:
        super().__init__()
        self._messages = messages

    def emit(self, record: logging.LogRecord) -> None:
        self._messages.append(" ".join(record.getMessage().split()))


@contextlib.contextmanager
def drake_messages() -> Iterator[list[str]]:
    """Collect Drake's warnings instead of printing them."""
    logger = logging.getLogger(_DRAKE)
    messages: list[str] = []
    handlers, propagate = logger.handlers, logger.propagate
    logger.handlers, logger.propagate = [_Collector(messages)], False
    try:
        yield messages
    finally:
        logger.handlers, logger.propagate = handlers, propagate


def use_native_logging() -> None:
    """Let Drake log without Python, and only errors.

    Its Meshcat may wait for ever at the end if its threads log through Python. What
    Drake warns about a robot is in the robot's report already.
    """
    logging.getLogger(_DRAKE).setLevel(logging.ERROR)
    use_native_cpp_logging()
