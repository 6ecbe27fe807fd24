"""Base class of Python systems, freed with its diagram.

Python frees what refers to itself in a circle, as a diagram does, if it sees the whole
circle. Of systems written in Python it doesn't, for three reasons, and then a diagram
stays in memory with its plant until the process ends. The tests show each reason.

* A Python class without `__slots__` adds a dictionary, and pydrake's systems have one
  already. With pybind11 (Drake 1.51) both are the same one, so Python counts what is in
  it twice, and takes the system for one that is used from elsewhere.
* Drake holds the functions that calculate output ports. These hold the system, and
  Python doesn't see who holds them (RobotLocomotion/drake, issue 24162). Events are
  mended in Drake 1.51, and outputs of vectors in 1.58.
* pydrake keeps a plant or scene graph alive as long as some of what it returned exists:
  bodies, joints, frames, identifiers of shapes, what `get_query_output_port` returns. A
  system that is to be freed keeps none of these, but indices, numbers and the ports
  that `GetOutputPort` returns.

The first two are seen to here, the last one where such things are kept. Whoever has any
part of a diagram in hand still has all of it, which is Drake's doing, in a way that
Python sees.
"""

import functools
import weakref
from typing import Any

from pydrake.systems.framework import LeafSystem, OutputPort

_metaclass: Any = type(LeafSystem)
if _metaclass.__module__.startswith("pybind11"):  # nanobind, of Drake 1.58, needs none.

    class _WithoutDictionary(_metaclass):
        """Makes classes that add no dictionary to that of their base."""

        def __new__(
            cls, name: str, bases: tuple[type, ...], names: dict[str, Any], **more: Any
        ) -> Any:
            names.setdefault("__slots__", ())
            # After each unrestricted update Drake asks every system for its witness
            # functions, and pybind11 looks for a Python function of this name: one in C
            # it takes for its own, and doesn't look again.
            names.setdefault("DoGetWitnessFunctions", len)
            return super().__new__(cls, name, bases, names, **more)

    _metaclass = _WithoutDictionary


class PythonSystem(LeafSystem, metaclass=_metaclass):
    """A LeafSystem that is freed with its diagram, as the module's docstring says."""

    def DeclareVectorOutputPort(self, *args: Any, **kwargs: Any) -> OutputPort:
        """Declare a port, as a LeafSystem does."""
        kwargs = {name: self._hold(value) for name, value in kwargs.items()}
        return super().DeclareVectorOutputPort(*map(self._hold, args), **kwargs)

    def DeclareAbstractOutputPort(self, *args: Any, **kwargs: Any) -> OutputPort:
        """Declare a port, as a LeafSystem does."""
        kwargs = {name: self._hold(value) for name, value in kwargs.items()}
        return super().DeclareAbstractOutputPort(*map(self._hold, args), **kwargs)

    def _hold(self, argument: Any) -> Any:
        """Return what calls a function but doesn't hold it: the system does.

        What isn't a function is returned as it is.
        """
        if not callable(argument):
            return argument
        reference = functools.partial(
            argument
        )  # There are weak references to all of these.
        self.__dict__.setdefault("_held", []).append(reference)
        return weakref.proxy(reference)
