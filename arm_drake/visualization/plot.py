"""Pictures of a rollout, with matplotlib."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from arm_drake.errors import InputError, suggest
from arm_drake.output_files import check_suffix, writing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from arm_drake.planning.motion_planning import Plan
    from arm_drake.rollout.rollout import Rollout

# What a plot of a rollout can show; the first is the default.
PLOT_KINDS = ("overview", "tracking", "error", "effort", "phase", "path")

PLOT_SUFFIXES = (".png", ".svg", ".pdf")


def check_plot_path(path: Path) -> None:
    """Raise OutputError if a picture can't be of this type."""
    check_suffix(path, "a picture", PLOT_SUFFIXES)


def draw_rollout(
    rollout: "Rollout",
    path: Path | None = None,
    *,
    kind: str = "overview",
    joints: Sequence[str] | None = None,
    link: str | None = None,
) -> "Figure":
    """Return a picture of a rollout.

    Args:
        rollout: The rollout.
        path: `.png`, `.svg` or `.pdf` file to write; None writes none.
        kind: One of PLOT_KINDS.
        joints: Which joints, in this order; None is all of them.
        link: Whose way is drawn; None is the end effector.

    Raises:
        InputError: If there is no such kind, joint or link, or the rollout lacks what
            it takes.
        OutputError: If the picture can't be written.
    """
    if kind not in PLOT_KINDS:
        raise InputError(
            f"unknown kind {kind!r} of a plot; {suggest(kind, PLOT_KINDS)}"
        )
    if link is not None and kind not in ("path", "overview"):
        raise InputError(f"a {kind} plot has no link; it is for path and overview")
    chosen = rollout.joint_names if joints is None else tuple(joints)
    for name in chosen:
        if name not in rollout.joint_names:
            hint = suggest(name, rollout.joint_names)
            raise InputError(f"no joint {name!r} in the rollout; {hint}")
    if path is not None:
        check_plot_path(path)
    picture = _draw(rollout, kind, chosen, link)
    if path is not None:
        with writing(path):
            picture.savefig(path)
    return picture


def draw_plan(plan: "Plan", path: Path | None = None) -> "Figure":
    """Return a picture of a plan: its joints over time, and the way of its link.

    Args:
        plan: The plan.
        path: `.png`, `.svg` or `.pdf` file to write; None writes none.

    Raises:
        OutputError: If the picture can't be written.
    """
    if path is not None:
        check_plot_path(path)
    from arm_drake.visualization.plots import plot_plan

    picture = plot_plan(plan)
    if path is not None:
        with writing(path):
            picture.savefig(path)
    return picture


def _draw(
    rollout: "Rollout", kind: str, joints: Sequence[str], link: str | None
) -> "Figure":
    """Return a picture of a kind, which says so if there is nothing in it."""
    # Not at the top: a simulation without pictures must not wait for matplotlib.
    from arm_drake.visualization.plot_panels import say_if_empty
    from arm_drake.visualization.plots import (
        plot_effort,
        plot_error,
        plot_overview,
        plot_path,
        plot_phase,
        plot_tracking,
    )

    by_joint = {
        "tracking": plot_tracking,
        "error": plot_error,
        "effort": plot_effort,
        "phase": plot_phase,
    }
    if kind == "path":
        picture = plot_path(rollout, link)
    elif kind == "overview":
        picture = plot_overview(rollout, joints, link)
    else:
        picture = by_joint[kind](rollout, joints)
    say_if_empty(picture, len(rollout.time))
    return picture
