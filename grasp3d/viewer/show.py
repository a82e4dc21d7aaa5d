"""`labels.show()`, `grasps.show()`, `mesh.show()`: the viewer in a notebook or in a window."""

import asyncio
import base64
import html
import io
import os
import sys
import threading
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cache
from importlib import import_module

from PIL import Image

from grasp3d.errors import SettingError
from grasp3d.mesh import MeshSource, load_mesh
from grasp3d.settings import AnySampling, GraspModel
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.progress import ignore
from grasp3d.viewer.session.collection import (
    Collection,
    collection_of,
    collection_of_grasps,
    collection_of_mesh,
)
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import ViewSettings
from grasp3d.viewer.web.page import (
    HOST,
    PORT,
    address_of,
    can_serve,
    create_server,
    listen,
    serving,
)

HUB = "JUPYTERHUB_SERVICE_PREFIX"
"""Environment variable of JupyterHub with the path of a user's server."""
START_TIMEOUT = 60.0
"""Longest wait for the server to start [s]."""

INSTALL_NOTE = (
    "This is a picture. For an interactive view: "
    "<code>pip install 'grasp3d[web]'</code> and restart the kernel."
)


@dataclass(frozen=True)
class NotebookView:
    """HTML that a notebook displays below a cell."""

    content: str

    def _repr_html_(self) -> str:
        return self.content


def show(
    shown: SurfaceLabels | GraspTable | MeshSource,
    settings: ViewSettings | None = None,
    *,
    model: GraspModel | None = None,
    sampling: AnySampling | None = None,
    height: int = 640,
    proxy: str | None = None,
) -> NotebookView | None:
    """View a labelled surface, grasps or a mesh: in a notebook below the cell, else in a window.

    In a notebook the kernel serves a page at a port of its machine. If the browser runs on another
    machine, forward that port, or use jupyter-server-proxy.

    Args:
        shown: Labels; grasps, of which one is shown at a time; or a mesh, as in `load_mesh`, which
            is labelled first.
        settings: Initial view; None: the defaults.
        model: For a mesh: friction, sensor resolution and fingers of its labels.
        sampling: For a mesh: how grasps are searched for.
        height: Height of the page in a notebook [pixels].
        proxy: Path at which a proxy serves the ports of the kernel's machine, such as '/proxy/' or
            '/user/name/proxy/' for jupyter-server-proxy; None: the path that JupyterHub gives, if
            any, otherwise the browser runs on the same machine.

    Returns:
        The view that a notebook displays; None after a window was closed.

    Raises:
        MeshError: It is no mesh.
        SettingError: There are no grasps, or a model is given for labels or grasps.
        OutputError: Nothing can be rendered here.
    """
    settings = settings or ViewSettings()
    collection = _collection(shown, model, sampling)
    if not in_notebook():
        import_module("grasp3d.viewer.window.desktop").show_window(Session(collection, settings))
        return None
    if not can_serve():
        return _picture(collection, settings)
    source = html.escape(_base(proxy) + server().add(collection, settings))
    name = html.escape(collection.items[0].name)
    return NotebookView(
        f'<iframe src="{source}" title="grasp3d: {name}" width="100%" height="{height}" '
        'style="border: 1px solid #d9dee2; border-radius: 6px" allowfullscreen></iframe>'
    )


def _collection(
    shown: SurfaceLabels | GraspTable | MeshSource,
    model: GraspModel | None,
    sampling: AnySampling | None,
) -> Collection:
    if not isinstance(shown, SurfaceLabels | GraspTable):
        return collection_of_mesh(load_mesh(shown), model, sampling)
    if not (model is None and sampling is None):
        raise SettingError("labels and grasps have a model already; give one for a mesh only")
    return collection_of(shown) if isinstance(shown, SurfaceLabels) else collection_of_grasps(shown)


def in_notebook() -> bool:
    """Whether a notebook's kernel is running, and not a terminal."""
    ipython = sys.modules.get("IPython")  # a notebook has always imported it
    shell = ipython and ipython.get_ipython()
    return getattr(shell, "kernel", None) is not None


class BackgroundServer:
    """Serves pages in a thread, for the lifetime of the process."""

    def __init__(self) -> None:
        self._server = create_server()
        self._listener = listen(HOST, PORT)
        started: Future[None] = Future()
        thread = threading.Thread(target=self._run, args=(started,), daemon=True, name="grasp3d")
        thread.start()
        started.result(START_TIMEOUT)

    @property
    def address(self) -> str:
        """Its address on the same machine."""
        return address_of(HOST, self._listener)

    @property
    def port(self) -> int:
        """Its port."""
        return int(self._listener.getsockname()[1])

    def add(self, collection: Collection, settings: ViewSettings) -> str:
        """Add a collection; returns its path."""
        return self._server.add(collection, settings)

    def allow_other_hosts(self) -> None:
        """Accept requests through a proxy, with any host name."""
        self._server.local_only = False

    def _run(self, started: "Future[None]") -> None:
        async def forever() -> None:
            async with serving(self._server, self._listener):
                started.set_result(None)
                await asyncio.Event().wait()

        try:
            asyncio.run(forever())
        except Exception as error:  # noqa: BLE001
            if not started.done():
                started.set_exception(error)


@cache
def server() -> BackgroundServer:
    """The server of this process; started at the first call."""
    return BackgroundServer()


def _base(proxy: str | None) -> str:
    """Beginning of the addresses of pages."""
    if proxy is None and HUB in os.environ:
        proxy = os.environ[HUB].rstrip("/") + "/proxy/"
    if proxy is None:
        return server().address
    server().allow_other_hosts()
    return f"{proxy.rstrip('/')}/{server().port}/"


def _picture(collection: Collection, settings: ViewSettings) -> NotebookView:
    """A picture of the initial view.

    Raises:
        OutputError: There is no OpenGL.
    """
    data = io.BytesIO()
    pictures = import_module("grasp3d.viewer.scene.pictures")
    with pictures.open_renderer(collection, settings, ignore) as renderer:
        Image.fromarray(renderer.picture()).save(data, "PNG")
    encoded = base64.b64encode(data.getvalue()).decode()
    name = html.escape(collection.items[0].name)
    return NotebookView(
        f'<img src="data:image/png;base64,{encoded}" alt="Surface of {name}" '
        f'style="max-width: 100%"><p>{INSTALL_NOTE}</p>'
    )
