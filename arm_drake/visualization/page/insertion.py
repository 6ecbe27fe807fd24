"""Insertion of things into a running simulation, on its page."""

import itertools
from typing import Any

import numpy as np

from arm_drake.errors import InputError
from arm_drake.visualization.page.parts import Live, Part
from arm_drake.visualization.page.widgets import (
    Button,
    Buttons,
    Choice,
    Section,
    Slider,
)
from arm_drake.worlds.things import COLORS, SHAPES, Thing

# Sliders: what they are called, their range, at first, and unit.
_SLIDERS = {
    "size": ("size", 0.01, 1.0, 0.05, "m"),
    "mass": ("mass", 0.01, 10.0, 0.1, "kg"),
    "x": ("x", -2.0, 2.0, 0.4, "m"),
    "y": ("y", -2.0, 2.0, 0.0, "m"),
    "z": ("z", 0.0, 2.0, 0.5, "m"),
}

# How far above another thing one is put that would lie in it [m].
_GAP = 1e-3

# Lengths of a thing of size 1 [m], as its kind takes them.
_SIZES = {"box": (1.0, 1.0, 1.0), "cylinder": (0.5, 1.0), "sphere": (0.5,)}


class Insertion(Part):
    """The section that puts boxes, cylinders and balls into the simulation."""

    word = "insert"

    def __init__(self, live: Live) -> None:
        """Create it."""
        self._live = live
        self.kind, self.color = "box", "orange"
        self.values = {name: start for name, (_, _, _, start, _) in _SLIDERS.items()}

    def insert(self) -> Thing:
        """Put a thing where the sliders say; return it."""
        scene = self._live.scene
        taken = {thing.name for thing in scene.things} if scene is not None else set()
        taken |= set(self._live.simulation.robots)
        names = (f"{self.kind}_{k}" for k in itertools.count(1))
        name = next(name for name in names if name not in taken)
        size, x, y, z = (self.values[what] for what in ("size", "x", "y", "z"))
        z = self._find_height(0.5 * size, np.array([x, y, z]))
        thing = Thing(
            name,
            self.kind,
            tuple(size * part for part in _SIZES[self.kind]),
            mass=self.values["mass"],
            color=(*COLORS[self.color], 1.0),
            pose=(x, y, z, 0.0, 0.0, 0.0),
        )
        self._live.insert(thing)
        return thing

    def _find_height(self, half: float, at: np.ndarray) -> float:
        """Return the height of something above what is in its place [m].

        Its half length is `half` [m]; other things are taken as large as their balls.
        """
        scene, poses = self._live.scene, self._live.simulation.things
        things = scene.things if scene is not None else ()
        for thing in sorted(
            (t for t in things if t.name in poses),
            key=lambda t: poses[t.name].translation()[2],
        ):
            middle, room = poses[thing.name].translation(), half + thing.radius
            if np.abs(at - middle).max() < room:
                at = np.array([at[0], at[1], middle[2] + room + _GAP])
        return float(at[2])

    def take_over(self, other: Part) -> None:
        """Keep what was chosen."""
        if isinstance(other, Insertion):
            self.kind, self.color = other.kind, other.color
            self.values = dict(other.values)

    def act(self, what: str, value: object) -> None:
        """Do what one of its widgets stands for."""
        if what == "now":
            self.insert()
        elif what in ("kind", "color"):
            known = SHAPES if what == "kind" else COLORS
            if value not in known:
                text = f"{what}: expected {', '.join(known)}, got {value!r}"
                raise InputError(text)
            setattr(self, what, value)
        elif what in _SLIDERS and isinstance(value, int | float):
            label, lower, upper, _, unit = _SLIDERS[what]
            if not lower <= value <= upper:
                text = f"expected {lower:g} to {upper:g} {unit}, got {value:g}"
                raise InputError(f"{label}: {text}")
            self.values[what] = float(value)

    def changes(self) -> dict[str, dict[str, Any]]:
        """Return present fields of its widgets, by id."""
        return {
            "insert:kind": {"value": self.kind},
            "insert:color": {"value": self.color},
            **{f"insert:{name}": {"value": v} for name, v in self.values.items()},
        }

    def section(self) -> Section:
        """Return its part of the panel."""
        sliders = (
            Slider(f"insert:{name}", label, lower, upper, self.values[name], unit)
            for name, (label, lower, upper, _, unit) in _SLIDERS.items()
        )
        hint = "time, robots and things go on as they are"
        return Section(
            "Insert a thing",
            (
                Choice("insert:kind", "shape", tuple(SHAPES), self.kind),
                Choice("insert:color", "colour", tuple(COLORS), self.color),
                *sliders,
                Buttons((Button("insert:now", "insert", hint),)),
            ),
            is_open=False,
        )


def make_insertion(live: Live) -> Insertion | None:
    """Return the section, where a simulation can be built with one thing more."""
    return Insertion(live) if live.can_insert else None
