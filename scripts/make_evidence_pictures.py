"""Draw the pictures of the page of evidence.

    python scripts/validate_physics.py -o physics
    python scripts/make_evidence_pictures.py physics GRASPS --mesh MESH -o docs

GRASPS is a file of poses with outcomes, as for `grasp3d validate`. Writes `evidence_labels.png` and
`evidence_calibration.png`, success of those grasps by label and by margin, and
`evidence_failures.png`, grasps of shipped meshes that were labelled S and failed in simulation.
Needs OpenGL (EGL or a display).
"""

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d import load_mesh, validate_grasps
from grasp3d.arrays import Bytes
from grasp3d.plots.formats import save_as
from grasp3d.plots.rendering import Finger, View, picture
from grasp3d.plots.style import Drawing, new_figure, styled
from grasp3d.plots.validations import calibration_figure, label_figure
from grasp3d.system.tables import read_columns

MESHES = Path(__file__).parents[1] / "meshes"
CAUSES = {
    "soft": "pulled at its centre of mass:\nit turns about the tips",
    "weak": "squeezed by twice its weight:\nthe pull decides",
}
"""Why S grasps failed under each condition of `validate_physics.py`."""

OBJECT = (214, 190, 150)
PIXELS = (460, 420)
PANELS = 4


def failures(folder: Path) -> list[dict[str, Any]]:
    """S grasps that were lost, those with the largest margins, one of an object and condition."""
    found = []
    for cause in CAUSES:
        for path in sorted(folder.glob(f"{cause}_*.csv")):
            columns = read_columns(path)
            lost = np.flatnonzero((columns["label"] == "S") & (columns["fate"] == "pulled"))
            if len(lost):
                row = lost[np.argmax(columns["margin"][lost])]
                one = {name: values[row] for name, values in columns.items()}
                found.append({**one, "cause": cause, "object": path.stem.removeprefix(f"{cause}_")})
    return sorted(found, key=lambda one: -float(one["margin"]))[:PANELS]


def rendered(one: dict[str, Any]) -> Bytes:
    """The object with both tips, seen across the line between them."""
    (path,) = MESHES.glob(f"{one['object']}.*")
    mesh = load_mesh(path, unit="m")
    points = np.array([[one[f"{axis}{tip}"] for axis in "xyz"] for tip in (1, 2)])
    normals = np.array([[one[f"n{axis}{tip}"] for axis in "xyz"] for tip in (1, 2)])
    line = points[1] - points[0]
    upright = abs(line[2]) > 0.9 * float(np.linalg.norm(line))
    across = np.cross(line, [0.0, 1.0, 0.0] if upright else [0.0, 0.0, 1.0])
    across = across / np.linalg.norm(across) + [0.0, 0.0, 0.35]
    view = View(
        azimuth=math.atan2(across[1], across[0]),
        elevation=math.atan2(across[2], math.hypot(across[0], across[1])),
    )
    colors = np.tile(np.array(OBJECT, dtype=np.uint8), (len(mesh.vertices), 1))
    fingers = [Finger(point, normal) for point, normal in zip(points, normals, strict=True)]
    return picture(mesh.vertices, mesh.faces, colors, normals=-mesh.normals, view=view, size=PIXELS,
                   fingers=fingers)  # fmt: skip


@styled
def failure_figure(found: list[dict[str, Any]]) -> Drawing:
    """A panel for each grasp."""
    figure = new_figure(height=2.4)
    for axes, one in zip(figure.subplots(1, len(found)), found, strict=True):
        axes.imshow(rendered(one))
        axes.set_title(f"{one['object']}: S, margin {math.degrees(one['margin']):.0f}°", fontsize=8)
        turn, slip = math.degrees(one["turn"]), 1e3 * one["slip"]
        axes.set_xlabel(f"{CAUSES[one['cause']]}\nturn {turn:.0f}°, slip {slip:.0f} mm", fontsize=7)
        axes.set(xticks=[], yticks=[])
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
    return figure


def main() -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("physics", type=Path)
    parser.add_argument("grasps", type=Path)
    parser.add_argument("--mesh", type=Path, required=True)
    parser.add_argument("-o", "--output", type=Path, default=Path())
    given = parser.parse_args()
    save_as(failure_figure(failures(given.physics)), given.output / "evidence_failures.png")
    found = validate_grasps(given.grasps, mesh=given.mesh)
    save_as(calibration_figure(found), given.output / "evidence_calibration.png")
    save_as(label_figure(found), given.output / "evidence_labels.png")


if __name__ == "__main__":
    main()
