"""The report page of one mesh: its picture, facts on it, and its best grasps."""

import base64
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from grasp3d.arrays import Bytes
from grasp3d.batch.report_page import REPORT, address, environment
from grasp3d.batch.row import Row, headed
from grasp3d.describe.explanations import facts
from grasp3d.formats import write_glb
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.pictures.opengl import can_render
from grasp3d.pictures.stills import draw_grasps, draw_labels
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels

SIZE = (720, 540)
"""Size of the picture on the page [pixels]."""

SMALLER = 4
"""Factor by which the picture in the table is smaller."""

MOST = 4
"""Largest number of grasps that have a picture."""

QUALITY = 85
"""Quality of compressed pictures, from 0 to 100."""


def write_object(
    row: Row, labels: SurfaceLabels, best: GraspTable | EvaluatedPoses | None, folder: Path,
    path: str,
) -> Row:  # fmt: skip
    """Write the page of a mesh, its coloured surface, and its picture for the first page.

    If nothing can be rendered, the page has no pictures.

    Args:
        row: Row of the mesh.
        labels: The labelled surface.
        best: The best grasps; None: there are none.
        folder: Folder below which the files are written.
        path: Path of the files below the folder, without a suffix.

    Returns:
        The row, with the paths of the files.
    """
    page, model = f"{path}.html", f"{path}.glb"
    row = replace(row, page=page)
    (folder / page).parent.mkdir(parents=True)
    write_glb(folder / model, labels)
    picture, grasps, shown = "", list[str](), 0 if best is None else min(best.size, MOST)
    if can_render():
        pixels = draw_labels(labels, size=SIZE)
        row = replace(row, thumbnail=f"{path}.webp")
        (folder / row.thumbnail).write_bytes(_webp(pixels, SMALLER))
        picture = _embedded(pixels)
        if best is not None and shown:
            few = best.take(np.arange(shown))
            grasps = [_embedded(one) for one in draw_grasps(few, labels)]
    text = environment().get_template("object.html").render(
        row=row,
        up=address(REPORT, page),
        files={"labelled PLY": row.surface, "coloured GLB": model},
        page=page,
        picture=picture,
        parts={"S": row.stable, "M": row.ambiguous, "U": row.no_grasp_found},
        facts={
            column: row.text(name) for name, column in headed([row]).items() if name != "seconds"
        },
        grasps=[
            (Label(int(best.letter[number])).name, facts(best, number), grasps[number:number + 1])
            for number in range(best.size)
        ] if best is not None else [],
    )  # fmt: skip
    (folder / page).write_text(text, encoding="utf-8")
    return row


def _webp(pixels: Bytes, smaller: int = 1) -> bytes:
    """Compress a picture to WebP, at a reduced size."""
    file = io.BytesIO()
    Image.fromarray(pixels).reduce(smaller).save(file, "WEBP", quality=QUALITY, method=2)
    return file.getvalue()


def _embedded(pixels: Bytes) -> str:
    """Return a picture as a data address, which an element can contain."""
    return f"data:image/webp;base64,{base64.b64encode(_webp(pixels)).decode()}"
