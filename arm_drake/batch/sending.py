"""What goes between processes: functions, inputs and values as bytes."""

import pickle
from typing import Any

import cloudpickle

from arm_drake.errors import InputError


class SendError(InputError):
    """Something can't be sent to other processes."""


def loads(data: bytes) -> Any:
    """Return what `dumps` has made bytes of."""
    return pickle.loads(data)  # noqa: S301  Of our own program.


def dumps(what: Any, role: str) -> bytes:
    """Return something as bytes that another process can read.

    What modules define is sent by its name, and imported there. What a program or a
    notebook defines, lambdas, and functions in functions are sent with their code.

    Args:
        what: What to send.
        role: What it is, for messages, as "the function".

    Raises:
        SendError: If it can't be sent.
    """
    try:
        return bytes(cloudpickle.dumps(what))
    except Exception as error:  # Whatever classes of users raise.
        raise SendError(
            f"{role} can't be sent to other processes: {error}; expected what "
            "cloudpickle takes, or backend='threads' or 'serial'"
        ) from None
