"""Two rollouts in one picture, with matplotlib."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from arm_drake.arrays import Array
from arm_drake.output_files import writing
from arm_drake.visualization.plot import check_plot_path

_PANEL = (5.5, 1.6)  # inches


def plot_comparison(
    path: Path,
    names: Sequence[str],
    a: tuple[Array, Sequence[Array]],
    b: tuple[Array, Sequence[Array]],
    *,
    remark: str = "no difference",
) -> None:
    """Draw quantities of two rollouts: each with both, and what B has more than A.

    `names` have units. `a` and `b` are times [s], shape (N,), and values of each
    quantity; `remark` stands there if nothing is drawn. It may raise OutputError.
    """
    check_plot_path(path)
    # Not at the top: a comparison without a picture must not wait for matplotlib.
    from arm_drake.visualization.plot_panels import (
        LIMIT,
        MEASURED,
        add_legend,
        draw_line,
        make_picture,
        shorten,
    )

    rows = max(1, len(names))
    picture = make_picture(2.0 * _PANEL[0], _PANEL[1] * rows + 0.8)
    if not names:
        picture.text(0.5, 0.5, remark, ha="center", va="center", wrap=True)
    else:
        panels = picture.subplots(rows, 2, sharex=True, squeeze=False)
        time = a[0][(a[0] >= b[0][0]) & (a[0] <= b[0][-1])]
        for index, name in enumerate(names):
            both, apart = panels[index]
            draw_line(both, a[0], a[1][index], color=MEASURED, lw=3, label="A")
            draw_line(both, b[0], b[1][index], color="k", ls="--", lw=1, label="B")
            title = shorten(name, _PANEL[0])
            both.set_title(title, loc="left", fontsize="small")
            first, second = (np.interp(time, t, v[index]) for t, v in (a, b))
            draw_line(apart, time, second - first, color=LIMIT, lw=1.2, label="B − A")
            both.grid(alpha=0.3)
            apart.grid(alpha=0.3)
        add_legend(picture, panels[0])
        for panel in panels[-1]:
            panel.set_xlabel("time [s]")
    with writing(path):
        picture.savefig(path)
