"""What Drake says while it reads a model: kept, not printed."""

import contextlib
import logging
from collections.abc import Iterator

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
