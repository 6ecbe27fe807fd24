"""The robots and motions that come with arm_drake."""

from pathlib import Path


def _folder(name: str) -> Path:
    """Return a data folder: inside an installed package, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / name
    return installed if installed.is_dir() else package.parent / name


def models_folder() -> Path:
    """Return the folder of the bundled robot packages."""
    return _folder("models")


def configs_folder() -> Path:
    """Return the folder of controllers and motions of the bundled robots."""
    return _folder("configs")


def bundled_robots() -> dict[str, Path]:
    """Return the entry files of the bundled robots by name."""
    robots = {}
    for folder in sorted(models_folder().glob("*/")):
        for suffix in (".urdf.xacro", ".urdf"):
            entry = folder / "urdf" / f"{folder.name}{suffix}"
            if entry.is_file():
                robots[folder.name] = entry
                break
    return robots


def bundled_motions(robot: str) -> dict[str, Path]:
    """Return the motion files of a bundled robot by name."""
    folder = configs_folder() / robot / "motions"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}
