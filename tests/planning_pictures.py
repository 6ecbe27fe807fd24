"""The pictures of docs/planning.md: `python -m tests.planning_pictures FOLDER`.

A plan of the Doosan around boxes on the page of `arm-drake sim`, and the part of its
panel that asked for it.
"""

import argparse
import io
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import FloatRect, ViewportSize
from pydrake.math import RollPitchYaw

import arm_drake as ad
from arm_drake.visualization.screenshot import open_browser
from tests.browser.pages import Screen, look_at
from tests.page_pictures import serve

ROBOT = "doosan_a0912"

# Where the arm is, and where it is to be: a post stands between, under a beam.
START = {"joint1": -1.0, "joint2": 0.9, "joint3": 0.8, "joint5": 1.2}
END = {**START, "joint1": 1.0}

# Size, place and colour of boxes [m].
BOXES = (
    ("0.2 0.2 0.8", "0.7 0 0.4", "0.25 0.45 0.75"),
    ("0.3 0.3 0.25", "0.45 0.8 0.125", "0.8 0.65 0.3"),
    ("0.2 0.2 0.35", "0.85 -0.75 0.175", "0.8 0.65 0.3"),
    ("0.4 0.2 0.2", "0.0 -0.95 0.1", "0.75 0.35 0.3"),
)

# [pixels]; the panel's section isn't cut off.
_SIZE = ViewportSize(width=1000, height=1100)

# What of the scene is kept [pixels].
_SCENE = FloatRect(x=267, y=230, width=733, height=640)

# Colours of a picture: its file is a fourth as large as with all.
_COLORS = 256


def write_world(folder: Path) -> Path:
    """Write a world with boxes on the ground."""
    links = []
    for number, (size, place, color) in enumerate(BOXES):
        shape = f"<geometry><box><size>{size}</size></box></geometry>"
        links.append(
            f'<link name="box_{number}"><pose>{place} 0 0 0</pose>'
            f'<collision name="c">{shape}</collision><visual name="v">{shape}'
            f"<material><diffuse>{color} 1</diffuse></material></visual></link>"
        )
    text = (
        '<sdf version="1.9"><world name="boxes"><model name="ground"><static>true'
        '</static><link name="ground"><collision name="c"><geometry><plane/></geometry>'
        '</collision></link></model><model name="boxes"><static>true</static>'
        f"{''.join(links)}</model></world></sdf>"
    )
    file = folder / "boxes.sdf"
    file.write_text(text, encoding="utf-8")
    return file


def plan_on(screen: Screen) -> None:
    """Ask for a plan to where the joints are to be, and wait until it was played."""
    robot = ad.load_robot(ROBOT)
    X = robot.forward_kinematics(END, "link6")
    pose = [*X.translation(), *RollPitchYaw(X.rotation()).vector()]
    screen.page.locator("summary", has_text="Motion planning").click()
    for name, value in zip(["x", "y", "z", "roll", "pitch", "yaw"], pose, strict=True):
        screen.type(f"plan:{name}", f"{value:.4f}")
    screen.until(lambda: "free" in screen.text("plan:status"), "the goal is free")
    screen.click("plan:plan")
    screen.until(lambda: "found in" in screen.text("plan:status"), "there is a plan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", metavar="FOLDER", type=Path)
    output = parser.parse_args().output
    with tempfile.TemporaryDirectory() as folder, open_browser() as browser:
        words = ["sim", ROBOT, "--world", str(write_world(Path(folder)))]
        for joint, position in START.items():
            words += ["--initial", f"{joint}={position}"]
        with serve(words) as url, look_at(browser, url, viewport=_SIZE) as screen:
            plan_on(screen)
            panel = screen.page.locator("details", has_text="velocity scaling")
            write(panel.screenshot(), output / "planning_panel.png")
            screen.picture()  # The ghost has arrived; its trail stays.
            write(screen.page.screenshot(clip=_SCENE), output / "planning.png")


def write(picture: bytes, file: Path) -> None:
    """Write a picture with few colours."""
    few = Image.open(io.BytesIO(picture)).convert("RGB").quantize(_COLORS)
    few.save(file, optimize=True)


if __name__ == "__main__":
    main()
