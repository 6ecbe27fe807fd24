"""All robots of a folder on one picture: `python -m tests.contact_sheet OUT.png`.

For developers who want to see what a change does to real robots.
"""

import argparse
import io
from pathlib import Path
from typing import Any

import yaml
from PIL import Image, ImageDraw, ImageFont
from pydrake.geometry import Meshcat

import arm_drake as ad
from arm_drake.errors import ArmDrakeError
from arm_drake.plant.plant import use_native_logging
from arm_drake.visualization.screenshot import Photographer
from tests.shown import show_robot

_TILE = (480, 360)  # pixels
_LABEL = 24
_COLUMNS = 5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", metavar="OUT.png", type=Path)
    parser.add_argument("names", metavar="NAME", nargs="*", help="only these robots")
    parser.add_argument(
        "--robots",
        type=Path,
        default=Path(__file__).parents[2] / "shared" / "robots",
        help="folder with an INDEX.yaml",
    )
    options = parser.parse_args()
    use_native_logging()
    index = yaml.safe_load((options.robots / "INDEX.yaml").read_text(encoding="utf-8"))
    rows = [
        row
        for row in index["robots"]
        if not options.names or row["name"] in options.names
    ]
    tiles = []
    # One for all: a Meshcat must end in the thread that made it.
    meshcat = ad.start_meshcat()
    with Photographer() as photographer:
        for row in rows:
            meshcat.Delete()
            try:
                picture = take_picture(options.robots, row, meshcat, photographer)
                label = row["name"]
            except ArmDrakeError as error:
                picture = None
                label = f"{row['name']}: no picture"
                print(f"{row['name']}: {error}")
            tiles.append(make_tile(picture, label))
    paste(tiles).save(options.output)


def take_picture(
    folder: Path, row: dict[str, Any], meshcat: Meshcat, photographer: Photographer
) -> bytes:
    """Return a picture of a robot of the index, as PNG."""
    robot = ad.load_robot(
        folder / row["entry"],
        controllers=[folder / file for file in row["controllers_yaml"]],
        xacro_args={name: str(value) for name, value in row["xacro_args"].items()},
        variables=row["launch_vars"],
    )
    show_robot(meshcat, robot)
    picture, _ = photographer.take_picture(meshcat, size=_TILE)
    return picture


def make_tile(picture: bytes | None, label: str) -> Image.Image:
    """Return a picture with a name under it."""
    width, height = _TILE
    tile = Image.new("RGB", (width, height + _LABEL), "white")
    if picture is not None:
        tile.paste(Image.open(io.BytesIO(picture)).convert("RGB"), (0, 0))
    draw = ImageDraw.Draw(tile)
    font = ImageFont.load_default(size=16)
    draw.text((width / 2, height + 2), label, "black", font, anchor="ma")
    return tile


def paste(tiles: list[Image.Image]) -> Image.Image:
    """Return tiles side by side, row by row."""
    columns = min(_COLUMNS, len(tiles))
    width, height = _TILE[0], _TILE[1] + _LABEL
    rows = -(-len(tiles) // columns)
    sheet = Image.new("RGB", (columns * width, rows * height), "white")
    for number, tile in enumerate(tiles):
        row, column = divmod(number, columns)
        sheet.paste(tile, (column * width, row * height))
    return sheet


if __name__ == "__main__":
    main()
