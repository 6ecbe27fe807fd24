"""What stands in a notebook's cell in place of a window."""

import html
import os
import sys
from pathlib import Path

from arm_drake.output_files import writing

_LAYOUT = 'width="100%" height="520" style="border: 1px solid #ccc"'

# Modules and variables of notebooks that run on another machine than their browser.
_REMOTE_MODULES = ("google.colab",)
_REMOTE_VARIABLES = (
    "BINDER_LAUNCH_HOST",
    "JUPYTERHUB_SERVICE_PREFIX",
    "KAGGLE_KERNEL_RUN_TYPE",
)


class Recording:
    """What was recorded of a simulation; in a notebook its value plays in the cell."""

    def __init__(self, page: str) -> None:
        """Create it.

        Args:
            page: A page of HTML that needs nothing else.
        """
        self.html = page

    def save(self, path: str | Path) -> None:
        """Write it as a file that any browser opens.

        Args:
            path: HTML file.

        Raises:
            OutputError: If it can't be written.
        """
        with writing(Path(path)):
            Path(path).write_text(self.html, encoding="utf-8")

    def _repr_html_(self) -> str:
        return html_in_a_cell(self.html)


def is_browser_elsewhere() -> bool:
    """Return whether the notebook's browser can't reach pages of this machine."""
    return any(name in sys.modules for name in _REMOTE_MODULES) or any(
        name in os.environ for name in _REMOTE_VARIABLES
    )


def html_in_a_cell(page: str) -> str:
    """Return what shows a page of HTML inside a notebook's cell.

    Args:
        page: The page.
    """
    return f'<iframe srcdoc="{html.escape(page)}" {_LAYOUT}></iframe>'


def page_in_a_cell(url: str) -> str:
    """Return what shows a page inside a notebook's cell.

    Args:
        url: The page's address.
    """
    return f'<iframe src="{url}" {_LAYOUT}></iframe>'
