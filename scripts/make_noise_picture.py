"""Draw the labels of a scan of known noise, of its noisy copies, and with the advised errors.

    python scripts/make_noise_picture.py -o docs/noise.png

Needs OpenGL (EGL or a display).
"""

import argparse
import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh

from grasp3d import MeshOptions, load_mesh
from grasp3d.plots.formats import save_as
from grasp3d.plots.perturbations import perturbation_figure
from grasp3d.plots.rendering import View
from grasp3d.validating.perturbing import NoiseSettings, perturb_surface

MESH = Path(__file__).parents[1] / "meshes" / "bulb.glb"
NOISE, PATCH = 0.0003, "3mm"
"""Standard deviation of the errors [m], and radius of the patch."""
SEED = 1


def main() -> None:
    """Make the scan, label its copies and write the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("noise.png"))
    parser.add_argument("--copies", type=int, default=50)
    options = parser.parse_args()
    fine = load_mesh(MESH)
    errors = np.random.default_rng(SEED).normal(0.0, NOISE, len(fine.vertices))[fine.canonical]
    with TemporaryDirectory() as folder:
        scan = Path(folder) / "scan.ply"
        moved = fine.vertices + errors[:, None] * fine.normals
        trimesh.Trimesh(moved, fine.faces, process=False).export(scan)
        found = perturb_surface(
            scan,
            noise=NoiseSettings(copies=options.copies),
            options=MeshOptions(unit="m", patch_radius=PATCH),
        )
    save_as(perturbation_figure(found, view=View(azimuth=math.radians(30.0))), options.output)


if __name__ == "__main__":
    main()
