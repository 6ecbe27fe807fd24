"""Show a source package as it looks once it is installed, with links."""

from pathlib import Path, PurePosixPath

# An installed file or folder: its place below `share/<package>`, and where it lies.
Installed = tuple[PurePosixPath, Path]

# More than any package needs.
_MAX_LINKS = 50_000


def show_as_installed(package: Path, rules: list[Installed], shown: Path) -> None:
    """Fill a folder with links to a package's files, in their installed places.

    Args:
        package: Folder of the package; what it doesn't install is shown in place.
        rules: What is installed elsewhere.
        shown: The folder to fill; it must not exist.

    Raises:
        OSError: If a file or folder can't be read, or stands where another must be.
        ValueError: If a place lies outside the folder, or there are too many links.
    """
    shown.mkdir(parents=True)
    links = _Links()
    links.add_children(package, shown)
    for place, source in rules:
        if place.is_absolute() or ".." in place.parts:
            raise ValueError(f"{str(place)!r} lies outside of the package")
        folder = shown
        for part in place.parts[:-1]:
            folder = folder / part
            links.open_folder(folder)
        links.add(source, shown / place)


class _Links:
    """Makes links, and counts them."""

    def __init__(self) -> None:
        self._count = 0

    def add(self, source: Path, shown: Path) -> None:
        """Show a file or a folder; a folder that is shown already gets more content."""
        if source.is_dir() and shown.is_dir():
            self.open_folder(shown)
            self.add_children(source, shown)
            return
        self._link(source, shown)

    def add_children(self, source: Path, shown: Path) -> None:
        """Show what is in a folder."""
        for child in sorted(source.iterdir()):
            place = shown / child.name
            # A link to a folder may lead back to where we are.
            if child.is_symlink() and place.is_dir():
                if place.is_symlink():
                    self._link(child, place)
            else:
                self.add(child, place)

    def open_folder(self, shown: Path) -> None:
        """Make a folder of its own of a link to a folder, with links to its content."""
        if not shown.is_symlink():
            shown.mkdir(exist_ok=True)
            return
        target = shown.resolve()
        if not target.is_dir():
            raise NotADirectoryError(f"{str(target)!r} is no folder")
        shown.unlink()
        shown.mkdir()
        self.add_children(target, shown)

    def _link(self, source: Path, shown: Path) -> None:
        self._count += 1
        if self._count > _MAX_LINKS:
            raise ValueError(f"more than {_MAX_LINKS} links")
        shown.unlink(missing_ok=True)
        shown.symlink_to(source.resolve())
