"""The pictures of docs/cameras.md: `python -m tests.sensor_pictures FOLDER`.

What a camera sees of the myCobot in the house, and the way of a public mobile base
through the house: all scans of its lidar, drawn where its odometry takes it to be.
"""

import argparse
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from pydrake.math import RollPitchYaw

import arm_drake as ad
from arm_drake.messages import Odometry, Twist, Vector3
from tests.robots import load_real_robot

# From the living room by a door into the bedroom, and around the wall in it [m].
WAY = ((-1.0, 1.75), (-3.6, 1.8), (-4.8, 0.2), (-3.2, -0.7), (-3.2, -3.2), (-5.5, -3.2))

# How fast it drives and turns at most [m/s], [rad/s], and how often it is steered [s].
_SPEED, _TURN, _PERIOD = 0.7, 1.2, 0.1

# It turns on the spot until the point is so far ahead [rad].
_AHEAD = 0.5

# It goes for the next point when it is so near [m].
_NEAR = 0.15

# Scans that are drawn, one in so many steps of steering.
_EACH = 3

_TILE = (400, 300)  # pixels


def see_robot() -> Image.Image:
    """Return colours, depths and labels of the myCobot in the house."""
    where = (0.75, -0.6, 0.6, 0.0, 0.35, 2.47)
    robot = ad.add_camera(ad.load_robot("mycobot_280"), "world", where)
    camera = ad.Simulation(ad.build_diagram(robot, world="house")).camera("camera")
    sheet = Image.new("RGB", (3 * _TILE[0], _TILE[1]))
    for column, kind in enumerate(("color", "depth", "labels")):
        tile = Image.fromarray(camera.image(kind)).resize(
            _TILE, Image.Resampling.LANCZOS
        )
        sheet.paste(tile, (column * _TILE[0], 0))
    return sheet


def drive(simulation: ad.Simulation) -> Iterator[tuple[np.ndarray, Odometry]]:
    """Drive along the way; yield the base's true pose and its odometry, each period."""
    base = simulation.controller("mobile_base_controller")
    odometry = simulation.topic("/mobile_base_controller/odom")
    for goal in WAY:
        while True:
            X_WB = simulation.link_poses()["base_footprint"]
            ahead = X_WB.inverse() @ np.array([*goal, 0.0])
            distance = float(np.hypot(*ahead[:2]))
            if distance < _NEAR:
                break
            angle = math.atan2(ahead[1], ahead[0])
            turn = float(np.clip(2.0 * angle, -_TURN, _TURN))
            speed = min(_SPEED, 1.5 * distance) * max(0.0, 1.0 - abs(angle) / _AHEAD)
            base.send_velocity(Twist(Vector3(x=speed), Vector3(z=turn)))
            simulation.run(_PERIOD)
            X_WB = simulation.link_poses()["base_footprint"]
            yaw = RollPitchYaw(X_WB.rotation()).yaw_angle()
            yield np.array([*X_WB.translation()[:2], yaw]), odometry.value()


class Way(NamedTuple):
    """What a base saw on a whole way, where it was taken to be; it starts at 0, 0."""

    # Where it was [m], and the points of its scans [m], shape (n, 2) each.
    places: list[np.ndarray]
    scans: list[np.ndarray]


def measure_way() -> tuple[Way, Way]:
    """Return a way in the house: by the wheels' odometry, and by true poses."""
    world = ad.build_diagram(load_real_robot("pmb2"), world="house")
    simulation = ad.Simulation(world)
    lidar = simulation.lidar("base_laser")
    pose = simulation.link_poses()["base_footprint"]
    X_BL = pose.inverse() @ lidar.pose
    believed, true = Way([], []), Way([], [])
    for step, (at, odometry) in enumerate(drive(simulation)):
        if step % _EACH:
            continue
        ends = lidar.points("sensor") @ X_BL.rotation().matrix().T + X_BL.translation()
        told = odometry.pose.pose
        yaw = 2.0 * math.atan2(told.orientation.z, told.orientation.w)
        by_wheels = np.array([told.position.x, told.position.y, yaw])
        for place, way in ((by_wheels, believed), (at, true)):
            c, s = math.cos(place[2]), math.sin(place[2])
            way.places.append(place[:2])
            way.scans.append(ends[:, :2] @ np.array([[c, s], [-s, c]]) + place[:2])
    return believed, true


def draw_way(ways: Mapping[str, Way], file: Path) -> None:
    """Draw all scans of a way, one way of placing them beside the other."""
    figure = Figure(figsize=(12.0, 4.6))
    for index, (title, way) in enumerate(ways.items(), start=1):
        axes = figure.add_subplot(1, len(ways), index)
        points, places = np.vstack(way.scans), np.array(way.places)
        axes.plot(*points.T, ",", color="black", alpha=0.2)
        axes.plot(*places.T, color="tab:red", linewidth=1.5)
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title=title)
        axes.set(xlim=(-10.0, 10.0), ylim=(-6.5, 6.5))
    figure.tight_layout()
    figure.savefig(file, dpi=80, pil_kwargs={"optimize": True})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    see_robot().save(folder / "cameras.png", optimize=True)
    believed, true = measure_way()
    away = float(np.linalg.norm(believed.places[-1] - true.places[-1]))
    length = float(np.linalg.norm(np.diff(true.places, axis=0), axis=1).sum())
    print(f"{len(true.scans)} scans on {length:.1f} m; odometry ends {away:.2f} m off")
    ways = {"by the wheels' odometry": believed, "by true poses": true}
    draw_way(ways, folder / "lidar_way.png")


if __name__ == "__main__":
    main()
