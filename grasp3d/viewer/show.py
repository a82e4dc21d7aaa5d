"""`labels.show()`, `grasps.show()`, `mesh.show()`: the viewer in a notebook or in a window."""

import html
import os
import sys
from importlib import import_module
from typing import Any
from urllib.parse import urlsplit

from grasp3d.errors import SettingError
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.mesh import MeshSource, load_mesh
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.settings import GraspModel, Sampling
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.viewer.collection import (
    Collection,
    collection_of,
    collection_of_grasps,
    collection_of_mesh,
)
from grasp3d.viewer.session import Session

HUB = "JUPYTERHUB_SERVICE_PREFIX"
"""Environment variable in which JupyterHub states the path of a user's server."""


def show(
    shown: SurfaceLabels | GraspTable | EvaluatedPoses | MeshSource,
    settings: ViewSettings | None = None,
    *,
    model: GraspModel | None = None,
    sampling: Sampling | None = None,
    height: int = 640,
    proxy: str | None = None,
) -> Any:
    """View a labelled surface, grasps or a mesh: below the cell of a notebook, or in a window.

    In a notebook the kernel serves a page at a port of its machine. If the browser runs on another
    machine, forward that port, or use jupyter-server-proxy.

    Args:
        shown: Labels; grasps or evaluated poses, shown one at a time; or a mesh, as in `load_mesh`,
            which is labelled first.
        settings: Initial view; None: the defaults.
        model: For a mesh: friction, sensor resolution and fingers of its labels.
        sampling: For a mesh: settings of the search for grasps.
        height: Height of the page in a notebook [pixels].
        proxy: Path at which a proxy serves the ports of the kernel's machine, such as '/proxy/' or
            '/user/name/proxy/' for jupyter-server-proxy; None: the path that JupyterHub gives, if
            any, otherwise the browser runs on the same machine.

    Returns:
        The view that a notebook displays; None after a window has been closed.

    Raises:
        MeshError: The input is not a mesh.
        SettingError: There are no grasps, or a model is given for labels or grasps.
        OutputError: Nothing can be rendered here.
    """
    session = Session(_collection(shown, model, sampling), settings)
    if not in_notebook():
        import_module("grasp3d.viewer.window").show_window(session)
        return None
    if proxy is None and HUB in os.environ:
        proxy = os.environ[HUB].rstrip("/") + "/proxy/"
    page = import_module("grasp3d.viewer.page")
    address = page.serve_in_background(session, proxied=proxy is not None)
    if proxy is not None:
        served = urlsplit(address)
        address = f"{proxy.rstrip('/')}/{served.port}{served.path}"
    title = html.escape(f"grasp3d: {session.name}")
    display = import_module("IPython.display")
    return display.IFrame(address, "100%", height, extras=[f'title="{title}"'])


def _collection(
    shown: SurfaceLabels | GraspTable | EvaluatedPoses | MeshSource,
    model: GraspModel | None,
    sampling: Sampling | None,
) -> Collection:
    if not isinstance(shown, SurfaceLabels | GraspTable | EvaluatedPoses):
        return collection_of_mesh(load_mesh(shown), model, sampling)
    if not (model is None and sampling is None):
        raise SettingError("labels and grasps have a model already; give one for a mesh only")
    return collection_of(shown) if isinstance(shown, SurfaceLabels) else collection_of_grasps(shown)


def in_notebook() -> bool:
    """Whether a notebook's kernel is running, rather than a terminal."""
    ipython = sys.modules.get("IPython")  # a notebook has always imported it
    shell = ipython and ipython.get_ipython()
    return getattr(shell, "kernel", None) is not None
