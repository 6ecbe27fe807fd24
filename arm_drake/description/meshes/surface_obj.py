"""A mesh as it is, for contact over areas."""

import numpy as np

from arm_drake.description.meshes.surfaces import Surface


def encode_surface(surfaces: list[Surface]) -> bytes:
    """Return an OBJ file of all triangles.

    Args:
        surfaces: The surfaces [m]; at least one has triangles.
    """
    lines, first = [], 1
    faces = []
    for surface in surfaces:
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in surface.vertices.tolist()]
        faces.append(np.asarray(surface.faces) + first)
        first += len(surface.vertices)
    triangles = np.concatenate(faces).tolist()
    lines += [f"f {a} {b} {c}" for a, b, c in triangles]
    return ("\n".join(lines) + "\n").encode()
