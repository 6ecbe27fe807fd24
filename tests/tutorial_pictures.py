"""The picture of the tutorials' robots: `python -m tests.tutorial_pictures OUT.png`."""

import argparse
import io
import shlex
import tempfile
from pathlib import Path

from PIL import Image

import arm_drake as ad
from arm_drake.cli import main as arm_drake
from arm_drake.visualization.screenshot import Photographer

# What is simulated before a picture is taken.
COMMANDS = (
    "doosan_a0912 --motion tutorial --duration 4.2",
    "mycobot_280 control:=ros2_control --motion trajectories --duration 7.4 "
    "--pose 0 0 0.05 0 0 0 --world house",
    "centauri --motion ramp --duration 4",
    "lab5_arm --motion control --set 'joint_angles=[0.7, 0.5, 0.9]' --duration 6",
    "teslabot 'rpy:=0 0 3.1416' --motion air_curls --duration 8.5",
)

# From the house to the camera.
ABOVE = (0.35, -0.75, 1.0)

_TILE = (400, 300)  # pixels
_COLUMNS = 3


def take_pictures(folder: Path) -> list[Image.Image]:
    """Return pictures of the robots, and of the house from above."""
    tiles = []
    for number, command in enumerate(COMMANDS):
        path = folder / f"{number}.png"
        words = shlex.split(command)
        arm_drake(["sim", *words, "--headless", "--screenshot", str(path)])
        tiles.append(Image.open(path))
    meshcat = ad.start_meshcat()
    robot = ad.load_robot("doosan_a0912")
    ad.Simulation(ad.build_diagram(robot, world="house", meshcat=meshcat)).run(0.01)
    with Photographer() as photographer:
        picture, _ = photographer.take_picture(meshcat, direction=ABOVE)
    return [*tiles, Image.open(io.BytesIO(picture))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", metavar="OUT.png", type=Path)
    output = parser.parse_args().output
    with tempfile.TemporaryDirectory() as folder:
        tiles = [tile.convert("RGB") for tile in take_pictures(Path(folder))]
    width, height = _TILE
    rows = -(-len(tiles) // _COLUMNS)
    sheet = Image.new("RGB", (_COLUMNS * width, rows * height))
    for number, tile in enumerate(tiles):
        row, column = divmod(number, _COLUMNS)
        small = tile.resize(_TILE, Image.Resampling.LANCZOS)
        sheet.paste(small, (column * width, row * height))
    sheet.save(output, optimize=True)


if __name__ == "__main__":
    main()
