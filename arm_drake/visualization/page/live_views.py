"""Views of a simulation: its robots, and what is shown beside them."""

import bisect
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import Context

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.description.joints import WORLD
from arm_drake.errors import InputError, check_known
from arm_drake.messages.sensors import ContactState
from arm_drake.plant.kinematics import KinematicPlant
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.contact_arrows import ContactArrows
from arm_drake.visualization.drawing import ROOM_TO_MOVE, draw, frame_robots
from arm_drake.visualization.ghost import BLUE, Ghost
from arm_drake.visualization.link_drawings import VISUAL_PATH
from arm_drake.visualization.meshcat import THREE_QUARTER, set_ground_visible
from arm_drake.visualization.page import Choice, Scene, Toggle, Widget
from arm_drake.visualization.page.panel import (
    LinkReadout,
    LinkViews,
    ThingFacts,
    frame_names,
    make_fixed_frame,
)
from arm_drake.visualization.trail import Trail
from arm_drake.worlds.things import free_bodies

# What is shown where nothing is.
_NOTHING = "none"

# Poses of links in the world, by robot and link.
_Poses = Mapping[str, Mapping[str, RigidTransform]]


class Pictures:
    """Positions of all that moves, at times that were drawn."""

    def __init__(self) -> None:
        """Create it without any."""
        self.times: list[float] = []
        self._positions: list[Array] = []

    def add(self, time: float, positions: Array) -> None:
        """Keep the positions of a time [s], if it is later than all others."""
        if not self.times or time > self.times[-1]:
            self.times.append(time)
            self._positions.append(positions)

    def at(self, time: float) -> Array:
        """Return the positions that were drawn last at a time [s]."""
        return self._positions[max(bisect.bisect_right(self.times, time) - 1, 0)]

    def trim(self, before: float) -> None:
        """Forget what was before a time [s]."""
        count = bisect.bisect_left(self.times, before)
        del self.times[:count], self._positions[:count]

    def clear(self) -> None:
        """Forget all."""
        self.times.clear()
        self._positions.clear()


class LiveViews:
    """Draws a simulation as it is now, or as it was."""

    def __init__(
        self,
        scene: Scene,
        simulation: Simulation,
        shown: Sequence[str] = ("visual",),
        *,
        is_recorded: bool = False,
    ) -> None:
        """Create it, and point the camera at the robots.

        The simulation's diagram draws on the scene. `shown` is what is shown at first,
        as in `LinkViews`.
        """
        self.scene = scene
        self._simulation = simulation
        # Whether what is drawn is kept for a recording.
        self.is_recorded = is_recorded
        self._robots = simulation.robots
        self._frames = frame_names(list(self._robots.values()))
        self._views = LinkViews(scene, shown)
        self._fixed_frame = WORLD
        self.readout = LinkReadout(scene, list(self._robots.values()))
        # Pose of the fixed frame as it was last drawn.
        self._X_WF = RigidTransform()
        self._has_ghosts = False
        self._trail: Trail | None = None
        self._trail_link = _NOTHING
        self._arrows: dict[str, ContactArrows] = {}
        # Where past positions are set, made when they are first asked for.
        self._past: Context | None = None
        self.look_anew()
        # How far the robots reach below the ground at first [m].
        self.depth = frame_robots(simulation, scene.meshcat, room=ROOM_TO_MOVE)

    def look_anew(self) -> None:
        """Draw the simulation's diagram from now on, another one than before."""
        simulation, diagram = self._simulation, self._simulation.diagram
        plant = diagram.GetSubsystemByName("plant")
        self.has_physics = not isinstance(plant, KinematicPlant)
        self._plant: MultibodyPlant = plant if self.has_physics else plant.plant
        self._scene_graph: SceneGraph = diagram.GetSubsystemByName("scene_graph")
        self._robots = simulation.robots
        has_contacts, self._past = bool(self._arrows), None
        self._things: dict[str, RigidBody] = {}
        for body in free_bodies(self._plant, self._robots) if self.has_physics else ():
            self._things.setdefault(str(body.name()), body)
        facts = {}
        for name, body in self._things.items():
            model = self._plant.GetModelInstanceName(body.model_instance())
            facts[name] = ThingFacts(f"{model}/{name}", float(body.default_mass()))
        self.readout.put(list(self._robots.values()), facts)
        self._models = {
            name: self._plant.GetModelInstanceByName(name) for name in self._robots
        }
        self._views.put(
            self._plant, self._scene_graph, self._models, list(self._robots.values())
        )
        self._ghosts = {
            name: self.make_ghost(name, name, BLUE) for name in self._robots
        }
        if has_contacts:
            self._show_contacts(False)
            self._show_contacts(True)

    def make_ghost(
        self, robot: str, name: str, color: tuple[float, float, float]
    ) -> Ghost:
        """Return a transparent copy of a robot, of another name and colour."""
        return Ghost(
            self.scene.meshcat,
            self._plant,
            self._scene_graph,
            self._models[robot],
            name,
            self._robots[robot].description,
            color=color,
        )

    def make_arrows(self, robot: str, name: str) -> ContactArrows:
        """Return arrows of forces on a robot, of a name, with nothing drawn."""
        mass = 1.0
        if self.has_physics:
            root = self._simulation.simulator.get_context()
            context = self._plant.GetMyContextFromRoot(root)
            mass = self._plant.CalcTotalMass(context, [self._models[robot]])
        poses = self._simulation.link_poses(robot).values()
        return ContactArrows.of_robot(self.scene.meshcat, name, mass, poses)

    def show(self, what: str, is_shown: bool = True) -> None:
        """Draw something, or don't."""
        if what == "ghost":
            self._has_ghosts = is_shown
            for ghost in self._ghosts.values():
                if not is_shown:
                    ghost.hide()
        elif what == "contacts":
            self._show_contacts(is_shown)
        else:
            self._views.show(what, is_shown)
        self.scene.patch({f"show:{what}": {"value": is_shown}})
        self.draw()

    def set_fixed_frame(self, frame: str) -> None:
        """Let a link stay where it is, and all else move around it, as in RViz.

        It is "world" or a link; with several robots, `<robot>/<link>`; else an
        InputError.
        """
        check_known("link", frame, self._frames, argument="fixed frame")
        self._fixed_frame = frame
        set_ground_visible(self.scene.meshcat, is_visible=frame == WORLD)
        self.scene.patch({"fixed_frame": {"value": frame}})
        self.draw()
        if frame == WORLD:  # All goes back, and stays there without being drawn.
            self._draw_links()

    def set_trail(self, frame: str | None) -> None:
        """Draw the way of a link's origin in the last 20 s, or none.

        It is named as for `set_fixed_frame`; else it is an InputError.
        """
        if self._trail is not None:
            self._trail.clear()
        self._trail = None
        if frame is not None:
            check_known("link", frame, self._frames[1:], argument="trail")
            self._trail_link = frame
            self._trail = Trail(self.scene.meshcat)
        self.scene.patch({"trail": {"value": frame or _NOTHING}})
        self.draw()

    def frame(self, direction: tuple[float, float, float] = THREE_QUARTER) -> None:
        """Point the camera at the robots, so that all of them is to be seen."""
        frame_robots(self._simulation, self.scene.meshcat, direction=direction)

    def drawn_poses(self) -> dict[str, RigidTransform]:
        """Return where links are drawn, by their names as frames."""
        poses = {name: self._simulation.link_poses(name) for name in self._robots}
        where = self._named(poses)
        X_FW = where.get(self._fixed_frame, RigidTransform()).inverse()
        return {name: X_FW @ X_WL for name, X_WL in where.items()}

    def draw(self) -> None:
        """Draw all as it is now."""
        draw(self._simulation)
        is_moving = self._fixed_frame != WORLD
        if is_moving or self._views.needs_poses or self._trail or self._has_ghosts:
            self._draw_links()
        for name, arrows in self._arrows.items():
            arrows.show(self._contacts(name))

    def refresh(self) -> None:
        """Update the readout's pose of a link, and its contacts."""
        poses = {name: self._simulation.link_poses(name) for name in self._robots}
        contacts: list[ContactState] = []
        if self.has_physics:
            for name in self._robots:
                contacts += self._contacts(name).states
        things = self._simulation.things if self._things else {}
        where = {**things, **self._named(poses)}
        self.readout.update(where, self._fixed_frame, contacts)

    def positions(self) -> Array:
        """Return the present positions of all that moves, for `draw_past`."""
        plant = self._simulation.diagram.GetSubsystemByName("plant")
        context = plant.GetMyContextFromRoot(self._simulation.simulator.get_context())
        if self.has_physics:
            return np.array(self._plant.GetPositions(context))
        return np.array(plant.GetOutputPort("positions").Eval(context))

    def draw_past(self, positions: Array) -> None:
        """Draw robots and things where they were, as `positions` said, and no more."""
        if self._past is None:
            self._past = self._plant.CreateDefaultContext()
        plant, context = self._plant, self._past
        plant.SetPositions(context, positions)
        inspector = self._scene_graph.model_inspector()
        for index in map(BodyIndex, range(1, plant.num_bodies())):
            frame = plant.GetBodyFrameIdIfExists(index)
            if frame is not None:
                path = inspector.GetName(frame).replace("::", "/")
                X_WB = plant.EvalBodyPoseInWorld(context, plant.get_body(index))
                self.scene.meshcat.SetTransform(f"{VISUAL_PATH}/{path}", X_WB)
        self.end_recording()
        for ghost in self._ghosts.values():
            ghost.hide()
        poses = {
            name: {
                link: plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(link, m))
                for link in self._robots[name].description.links
                if plant.HasBodyNamed(link, m)
            }
            for name, m in self._models.items()
        }
        things = {
            name: plant.EvalBodyPoseInWorld(context, body)
            for name, body in self._things.items()
        }
        self._move_frame(self._named(poses), None)
        self._views.update(poses)
        self.readout.update({**things, **self._named(poses)}, self._fixed_frame)

    def end_recording(self) -> None:
        """Leave out what would stand still in a recording: contact forces."""
        for arrows in self._arrows.values():
            arrows.hide()

    def widgets(self) -> tuple[Widget, ...]:
        """Return the toggles and choices of the panel."""
        label = "commanded pose, where it differs, as a ghost"
        extra = [Toggle("show:ghost", label, self._has_ghosts)]
        if self.has_physics:
            has_contacts = bool(self._arrows)
            extra.append(Toggle("show:contacts", "contact forces", has_contacts))
        value = self._trail_link if self._trail is not None else _NOTHING
        return (
            *self._views.toggles(),
            *extra,
            Choice("trail", "trail of", (_NOTHING, *self._frames[1:]), value),
            make_fixed_frame(list(self._robots.values()), self._fixed_frame),
        )

    def handle(self, event_id: str, value: object) -> bool:
        """Do what was clicked, and return whether it was one of these widgets."""
        kind, _, what = event_id.partition(":")
        if kind == "show":
            self.show(what, bool(value))
        elif kind == "trail":
            self.set_trail(None if value == _NOTHING else str(value))
        elif kind == "fixed_frame":
            self.set_fixed_frame(str(value))
        else:
            return self.readout.handle(event_id, value)
        return True

    def _show_contacts(self, is_shown: bool) -> None:
        for arrows in self._arrows.values():
            arrows.hide()
        self._arrows = {}
        if not is_shown:
            return
        if not self.has_physics:
            raise InputError("contact forces need physics, which this preset has not")
        self._arrows = {name: self.make_arrows(name, name) for name in self._models}

    def _contacts(self, robot: str) -> Any:
        prefix = self._simulation.directory.manager(robot).prefix
        return self._simulation.eval_output(f"{prefix}contacts")

    def _named(self, poses: _Poses) -> dict[str, RigidTransform]:
        """Return poses of links by their names as frames."""
        many = len(poses) > 1
        return {
            f"{name}/{link}" if many else link: X_WL
            for name, links in poses.items()
            for link, X_WL in links.items()
        }

    def _move_frame(
        self, where: Mapping[str, RigidTransform], time: float | None
    ) -> None:
        """Move all so that the fixed frame stays."""
        X_WF = where.get(self._fixed_frame, RigidTransform())
        if self.is_recorded or not X_WF.IsExactlyEqualTo(self._X_WF):
            self.scene.meshcat.SetTransform("/drake", X_WF.inverse(), time)
            self._X_WF = RigidTransform(X_WF)

    def _draw_links(self) -> None:
        now = self._simulation.time
        time = now if self.is_recorded else None
        poses = {name: self._simulation.link_poses(name) for name in self._robots}
        where = self._named(poses)
        self._move_frame(where, time)
        self._views.update(poses, time)
        if self._trail is not None:
            point = where[self._trail_link].translation()
            self._trail.append(now, point, is_recorded=self.is_recorded)
        if self._has_ghosts:
            for name, ghost in self._ghosts.items():
                description = self._robots[name].description
                base = description.base if description.roots else WORLD
                positions = commanded_positions(self._simulation, name)
                base_pose = poses[name].get(base)
                # Where it is as commanded, only the robot itself is to be seen.
                hidden_at = None if self.is_recorded else poses[name]
                ghost.show(
                    positions, base_pose=base_pose, time=time, hidden_at=hidden_at
                )


def commanded_positions(simulation: Simulation, robot: str) -> dict[str, float]:
    """Return where controllers want the joints, and where they are if none does."""
    manager = simulation.directory.manager(robot)
    state = simulation.joint_states(robot)
    follows = {j.name for j in manager.robot.description.movable_joints if j.mimic}
    measured = zip(state.name, state.position, strict=True)
    positions = {name: q for name, q in measured if name not in follows}
    root = simulation.simulator.get_context()
    values = manager.read_numbers(root, manager.numbers.values)
    targets = {
        name.rpartition("/")[0]: float(value)
        for name, value in zip(manager.commands, values, strict=True)
        if name.endswith(f"/{interfaces.POSITION}")
    }
    for row in simulation.list_controllers():
        if row.state != "active":  # Or couldn't be loaded.
            continue
        # Those that command no positions, but follow some.
        owner, _, system = simulation.directory.find(row.name)
        if owner is manager and system.HasOutputPort("controller_state"):
            message = simulation.eval_output(f"{row.name}.controller_state")
            names = getattr(message, "joint_names", ())
            points = getattr(getattr(message, "reference", None), "positions", ())
            if len(names) == len(points):
                targets |= dict(zip(names, points, strict=True))
    commanded = {n: q for n, q in targets.items() if n in positions and np.isfinite(q)}
    return positions | commanded
