"""Bode plots with matplotlib: gain and phase of a linear model, joint by joint."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from arm_drake.arrays import Array
from arm_drake.output_files import writing
from arm_drake.visualization.plot import check_plot_path

_SIZE = (11.0, 6.5)  # inches


def plot_bode(
    path: Path, frequencies: Array, responses: Mapping[str, Mapping[str, Array]]
) -> None:
    """Draw responses, a column for each kind of them, a line for each joint.

    `frequencies` [rad/s], shape (k,); `responses` are complex, shape (k,), by the title
    of the column and the name of the joint. It may raise OutputError.
    """
    check_plot_path(path)
    # Not at the top: an analysis without a picture must not wait for matplotlib.
    from arm_drake.visualization.plot_panels import make_picture

    picture = make_picture(*_SIZE)
    panels = picture.subplots(2, len(responses), sharex=True, squeeze=False)
    hertz = frequencies / (2.0 * np.pi)
    for column, (title, lines) in enumerate(responses.items()):
        gain, phase = panels[:, column]
        gain.set_title(title, fontsize="medium")
        for name, response in lines.items():
            gain.loglog(hertz, np.abs(response), lw=1.3, label=name)
            degrees = np.degrees(np.unwrap(np.angle(response)))
            phase.semilogx(hertz, degrees, lw=1.3)
        gain.set_ylabel("gain")
        phase.set_ylabel("phase [°]")
        phase.set_xlabel("frequency [Hz]")
        for panel in (gain, phase):
            panel.grid(which="both", alpha=0.25)
    if responses:
        panels[0, -1].legend(fontsize="small")
    with writing(path):
        picture.savefig(path)
