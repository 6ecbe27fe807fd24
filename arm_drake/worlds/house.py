"""The house of the tutorials' worlds: our own furniture where theirs stands.

Names and poses are those of the models in automaticaddison's house.world, which has
AWS RoboMaker's residential furniture in it; shapes are our own.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from pydrake.geometry import Mesh
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame

from arm_drake.plant.ground import GROUND_FRICTION, add_ground
from arm_drake.worlds import furniture, ornaments
from arm_drake.worlds.furniture import BLACK, IVORY, MUSTARD, NAVY, RUST, SAGE, TEAL
from arm_drake.worlds.furniture_parts import Parts, drawing
from arm_drake.worlds.house_walls import floor, room_wall, walls, window
from arm_drake.worlds.pictures import desk_picture, picture

# Model instance of the pieces' frames.
HOUSE = "house"

# Where the pieces are: x, y, z [m], roll, pitch, yaw [rad]; zeros at the end left out.
PLACES: Mapping[str, Sequence[tuple[float, ...]]] = {
    "HouseWallB_01": [(0, 0)],
    "AirconditionerA_01": [(-9.19941, 2.41123, 2.084544)],
    "AirconditionerB_01": [(-2.004656, -5.22661, 0.003485)],
    "Ball_01": [(3.295503, 4.225674, 0.318684), (-6.945503, -4.22174, 0.318684)],
    "Bed_01": [(-6.165067, 2.03056, -1e-05)],
    "NightStand_01": [
        (-7.72551, 2.86042, 0.005258, -2e-06),
        (-4.407341, 2.86042, 0.005256, 0, 2e-06),
    ],
    "Board_01": [(2.779073, -5.392703, 1.538173)],
    "ChairA_01": [
        (7.11516, 0.209028, 0.024685, 1e-06, 0, -1.55607),
        (6.25506, 0.219468, 0.011308, 0, 0, -1.50414),
        (6.06678, 1.68075, 0.01, 0, 0, 1.56986),
        (7.00277, 1.67074, 0, 0, 0, 1.52363),
        (-8.27094, 1.91665, 0.03665),
    ],
    "ChairD_01": [
        (-1.380775, 4.104456),
        (0.325214, 4.104456, 0, 0, 0, -3.138741),
        (-8.270775, -4.504456, 0, 0, 0, 0.869673),
    ],
    "Chandelier_01": [
        (1.221061, 4.15574, 1.295),
        (-6.451061, -0.69204, 1.81),
        (7.824061, -1.59, 1.751),
        (1.221061, -1.59204, 1.7873),
    ],
    "Carpet_01": [(0.78505, -1.106647, 0.001106), (2.85405, 3.45, 0.000585)],
    "SecurityCamera_01": [(0.842134, -4.996294, 0.495067, 0, 0, -2.841039)],
    "CoffeeTable_01": [(1.512301, -1.733438, 0.041983, 0, 0, 0.01)],
    "CookingBench_01": [(9.038383, -3.35114, 0.90361, 0, 0, 3.137133)],
    "Curtain_01": [(-9.172642, 0.20376)],
    "KitchenTable_01": [(6.55269, 0.951173, -6e-06, 0, 0, -1.56413)],
    "ReadingDesk_01": [(-8.987262, 2.057058, 0, 0, 0, -0.004638)],
    "BalconyTable_01": [(-0.55624, 4.111241)],
    "Door_01": [(6.001449, -5.549002)],
    "Dumbbell_01": [(2.512849, 2.717787, 0.002183)],
    "Tablet_01": [(1.57283, -1.775857, 0.40179, -0.020625, -8e-05, -0.006317)],
    "FitnessEquipment_01": [(3.48472, 3.169104, 0.003168)],
    "FoldingDoor_01": [
        (-2.461096, 1.844219, 0.041881),
        (-2.461096, -4.05332, 0.041881),
    ],
    "Handle_01": [(5.724, -5.523, 0.9938, 0, 0, -3.1415)],
    "FoldingDoor_02": [(4.674231, 2.46451, 0, 0, 0, 3.14159), (4.8912, -4.84968)],
    "KitchenCabinet_01": [(8.002009, -3.836509, 0.012068, 0, 0, -3.140001)],
    "KitchenUtensils_01": [(9.285478, -5.021261, 1.141805)],
    "LightC_01": [(1.769567, -5.444371, 2.0), (-0.138245, -5.444371, 2.0)],
    "PortraitA_01": [(-2.71236, -4.817539, 1.0, 0, 0, 1.566796)],
    "PortraitB_01": [(-1.279683, -5.42963, 0, -0.076901, 0, -3.116718)],
    "PortraitB_02": [(5.737017, 3.08031, 0.3)],
    "PortraitB_03": [(3.07138, -5.349366, 0.005494, -0.168428, 0, 3.104232)],
    "PortraitA_02": [(7.937017, 3.08031, 0.3, 0, 0, 3.14)],
    "PortraitC_01": [(-9.294904, -4.526084, 1.0, 0, 0, 1.554734)],
    "PortraitD_01": [(0.789763, -5.478725, 1.8, 0, 0, 3.138531)],
    "PortraitD_02": [(6.870181, 3.08031, 1.488439)],
    "PortraitE_01": [(-5.773094, -5.492466, 1.0, 0, 0, 3.132627)],
    "PortraitE_02": [(-6.193025, -1.590208, 0.3, 0, 0, 0.00429)],
    "DeskPortraitA_01": [(-0.036864, -5.110156, 0.49866, 0, 0, 2.927784)],
    "DeskPortraitA_02": [
        (2.046082, -1.892926, 0.070388, -0.018328, -0.000441, 1.576216)
    ],
    "DeskPortraitC_01": [
        (-7.746377, 2.731075, 0.69462, 0.000488, -0.000359, -0.055499)
    ],
    "DeskPortraitC_02": [
        (0.964613, -1.586951, 0.127676, 0.001614, -0.000545, -1.578699)
    ],
    "DeskPortraitD_01": [(2.64556, -5.376225, 1.573738, 0, 0, -3.112826)],
    "DeskPortraitD_02": [
        (-0.589211, -5.10989, 0.192145, -1.5e-05, -0.000174, -3.112544)
    ],
    "DeskPortraitD_03": [(1.826729, -1.464881, 0.126208, 1e-05, 6e-06, -3.11438)],
    "DeskPortraitD_04": [(4.302132, -5.176568, 0.202496, 0.007118, -1e-06, 3.046683)],
    "DeskPortraitB_01": [(3.547376, -5.083898, -0.01266, -0.336622, -1e-06, 3.046741)],
    "DeskPortraitB_02": [(2.48627, -5.102525, -0.01266, -0.336621, 0, 3.046798)],
    "Rangehood_01": [(9.019794, -3.36994, 1.507605)],
    "Refrigerator_01": [(8.702731, -1.032031, 0, 0, 0, -1.563499)],
    "SeasoningBox_01": [(9.107968, -2.651726, 0.902458, -6e-06, 3.4e-05, 0.00129)],
    "ShoeRack_01": [(4.297978, -5.173566)],
    "SofaC_01": [(0.330699, -1.902792, 0.065992, 0, 0, 1.571733)],
    "Tableware_01": [(7.15317, 0.982767, 0.817812, -0.001238, -0.000976, 1.02476)],
    "Trash_01": [(-8.704151, 1.00058, 0.011)],
    "TV_01": [(0.824259, -5.382968, 0.676282, 0, 0, -1.561744)],
    "TV_02": [(-6.197322, -1.388739, 0.676282, 0, 0, -1.561744)],
    "TVCabinet_01": [(0.615509, -5.105954, -0.011049, 0, 0, 1.57)],
    "Vase_01": [(3.055663, -5.41308, 1.574958, 3e-06, 0.0017, 0.00084)],
    "RoomWall_01": [(-6.09755, -1.49618, 0.028124)],
    "FloorB_01": [(0, 0)],
    "Wardrobe_01": [(-3.14671, 2.476204, 0.000704, 0, 0, -1.569673)],
    "RoomWindow_01": [
        (-9.4186, -0.026285, 0.502739),
        (-9.4186, -2.37409, 0.502739),
        (9.422616, -3.373981, 0.502739, 0, 0, -3.136099),
        (9.422558, 0.96852, 0.496581, 0, 0, -3.136099),
        (4.722317, 4.470281, 0.502739, 0, 0, -3.136099),
        (3.48852, 5.600688, 0.502739, 0, 0, -1.566274),
        (1.140949, 5.600688, 0.502739, 0, 0, -1.566274),
        (-1.19934, 5.600688, 0.502739, 0, 0, -1.566274),
        (-2.396624, 4.387607, 0.502739),
    ],
}

_PIECES: Mapping[str, Callable[[], Parts]] = {
    "AirconditionerA_01": ornaments.air_conditioner,
    "AirconditionerB_01": ornaments.standing_air_conditioner,
    "BalconyTable_01": furniture.balcony_table,
    "Ball_01": ornaments.gym_ball,
    "Bed_01": furniture.bed,
    "Board_01": ornaments.board,
    "Carpet_01": ornaments.carpet,
    "ChairA_01": furniture.dining_chair,
    "ChairD_01": furniture.armchair,
    "Chandelier_01": ornaments.chandelier,
    "CoffeeTable_01": furniture.coffee_table,
    "CookingBench_01": ornaments.cooking_bench,
    "Curtain_01": ornaments.curtain,
    "DeskPortraitA_01": partial(desk_picture, RUST),
    "DeskPortraitA_02": partial(desk_picture, TEAL),
    "DeskPortraitB_01": partial(picture, 0.5, 0.7, IVORY, SAGE, RUST, NAVY),
    "DeskPortraitB_02": partial(picture, 0.5, 0.7, IVORY, MUSTARD, TEAL, frame=BLACK),
    "DeskPortraitC_01": partial(desk_picture, SAGE, BLACK),
    "DeskPortraitC_02": partial(desk_picture, MUSTARD, BLACK),
    "DeskPortraitD_01": partial(desk_picture, NAVY),
    "DeskPortraitD_02": partial(desk_picture, RUST, BLACK),
    "DeskPortraitD_03": partial(desk_picture, TEAL, BLACK),
    "DeskPortraitD_04": partial(desk_picture, SAGE),
    "Door_01": ornaments.front_door,
    "Dumbbell_01": ornaments.dumbbells,
    "FitnessEquipment_01": furniture.fitness_equipment,
    "FloorB_01": floor,
    "FoldingDoor_01": ornaments.folding_door,
    "FoldingDoor_02": ornaments.folding_door,
    "Handle_01": ornaments.handle,
    "HouseWallB_01": walls,
    "KitchenCabinet_01": furniture.kitchen_cabinet,
    "KitchenTable_01": furniture.kitchen_table,
    "KitchenUtensils_01": ornaments.kitchen_utensils,
    "LightC_01": ornaments.wall_lamp,
    "NightStand_01": furniture.night_stand,
    "PortraitA_01": partial(picture, 0.4, 0.6, IVORY, NAVY, MUSTARD),
    "PortraitA_02": partial(picture, 0.6, 0.9, IVORY, RUST, TEAL),
    "PortraitB_01": partial(picture, 0.7, 1.0, IVORY, TEAL, MUSTARD, RUST),
    "PortraitB_02": partial(picture, 0.6, 0.9, IVORY, NAVY, SAGE),
    "PortraitB_03": partial(picture, 0.6, 0.8, IVORY, RUST, MUSTARD, frame=BLACK),
    "PortraitC_01": partial(picture, 0.8, 1.0, IVORY, SAGE, NAVY, MUSTARD),
    "PortraitD_01": partial(picture, 1.2, 0.6, IVORY, TEAL, NAVY, RUST),
    "PortraitD_02": partial(picture, 0.9, 0.6, IVORY, MUSTARD, RUST, frame=BLACK),
    "PortraitE_01": partial(picture, 1.4, 0.8, IVORY, NAVY, TEAL, MUSTARD),
    "PortraitE_02": partial(picture, 0.7, 1.0, IVORY, RUST, SAGE),
    "Rangehood_01": ornaments.range_hood,
    "ReadingDesk_01": furniture.reading_desk,
    "Refrigerator_01": furniture.refrigerator,
    "RoomWall_01": room_wall,
    "RoomWindow_01": window,
    "SeasoningBox_01": ornaments.seasoning_box,
    "SecurityCamera_01": ornaments.security_camera,
    "ShoeRack_01": furniture.shoe_rack,
    "SofaC_01": furniture.sofa,
    "TV_01": furniture.television,
    "TV_02": furniture.television,
    "TVCabinet_01": furniture.tv_cabinet,
    "Tablet_01": ornaments.tablet,
    "Tableware_01": ornaments.tableware,
    "Trash_01": ornaments.trash,
    "Vase_01": ornaments.vase,
    "Wardrobe_01": furniture.wardrobe,
}


class Piece(NamedTuple):
    """A piece of the house, and where it is."""

    name: str
    kind: str
    pose: RigidTransform


def add_house(plant: MultibodyPlant) -> None:
    """Add the ground, and the house on it.

    All of it is part of the world body, with a frame for each piece, such as
    "Bed_01_001", in the model instance "house": a body that is welded to the world
    would cost time in every step.

    Args:
        plant: A plant that isn't finalized.
    """
    add_ground(plant)
    body, instance = plant.world_body(), plant.AddModelInstance(HOUSE)
    friction = CoulombFriction(GROUND_FRICTION, GROUND_FRICTION)
    for name, kind, X_WP in list_pieces():
        plant.AddFrame(FixedOffsetFrame(name, plant.world_frame(), X_WP, instance))
        parts, mesh = _make_piece(kind)
        label = f"{HOUSE}::{name}"
        plant.RegisterVisualGeometry(body, X_WP, mesh, label, np.ones(4))
        for i, part in enumerate(parts):
            if part.shape is not None:
                plant.RegisterCollisionGeometry(
                    body, X_WP @ part.pose, part.shape, f"{label}::{i}", friction
                )


def list_pieces() -> list[Piece]:
    """Return all pieces of the house; those of a kind are numbered."""
    pieces = []
    for kind, places in PLACES.items():
        for number, place in enumerate(places, start=1):
            x, y, z, roll, pitch, yaw = (*place, *([0.0] * (6 - len(place))))
            X_WP = RigidTransform(RollPitchYaw(roll, pitch, yaw), np.array([x, y, z]))
            pieces.append(Piece(f"{kind}_{number:03d}", kind, X_WP))
    return pieces


@cache
def _make_piece(kind: str) -> tuple[Parts, Mesh]:
    parts = _PIECES[kind]()
    return parts, drawing(parts, kind)
