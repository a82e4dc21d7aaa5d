"""`labels.show()`: a page in a notebook, elsewhere a window."""

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

from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.progress import ignore
from grasp3d.viewer.session.album import Album, album_of
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import ViewSettings
from grasp3d.viewer.web.page import HOST, PORT, address_of, can_serve, front_door, listening, opened

HUB = "JUPYTERHUB_SERVICE_PREFIX"
"""What JupyterHub puts before the addresses of one user's server."""
PATIENCE = 60.0
"""Longest wait for the server [s]."""

MORE = (
    "A picture; to turn it and to move friction and resolution: "
    "<code>pip install 'grasp3d[web]'</code> and restart the kernel."
)


@dataclass(frozen=True)
class Shown:
    """What a notebook shows below a cell."""

    content: str

    def _repr_html_(self) -> str:
        return self.content


def show(
    labels: SurfaceLabels,
    settings: ViewSettings | None = None,
    *,
    height: int = 640,
    proxy: str | None = None,
) -> Shown | None:
    """Look at labelled surface: in a notebook below the cell, elsewhere in a window.

    A notebook's page is served by the kernel, at a port that only its machine reaches. Where the
    browser runs on another machine, forward that port, or have jupyter-server-proxy do it.

    Args:
        labels: What is looked at.
        settings: How it is first shown; None: as usual.
        height: Of the page in a notebook [pixels].
        proxy: Where a proxy shows the ports of the kernel's machine, such as '/proxy/' or
            '/user/name/proxy/' of jupyter-server-proxy; None: as JupyterHub tells, where it does,
            else the browser runs on the same machine.

    Returns:
        What the notebook shows; None after a window was closed.

    Raises:
        OutputError: Nothing can be drawn here.
    """
    settings = settings or ViewSettings()
    album = album_of(labels)
    if not in_notebook():
        import_module("grasp3d.viewer.window.desktop").show_window(Session(album, settings))
        return None
    if not can_serve():
        return _still(album, settings)
    source = html.escape(_base(proxy) + server().offer(album, settings))
    name = html.escape(album.exhibits[0].name)
    return Shown(
        f'<iframe src="{source}" title="grasp3d: {name}" width="100%" height="{height}" '
        'style="border: 1px solid #d9dee2; border-radius: 6px" allowfullscreen></iframe>'
    )


def in_notebook() -> bool:
    """Tell whether a notebook's kernel runs this, and no terminal."""
    ipython = sys.modules.get("IPython")  # if nobody has imported it, this is no notebook
    shell = ipython and ipython.get_ipython()
    return getattr(shell, "kernel", None) is not None


class Server:
    """Serves the pages of one process, in a thread of its own, as long as the process lives."""

    def __init__(self) -> None:
        self._door = front_door()
        self._listener = listening(HOST, PORT)
        started: Future[None] = Future()
        thread = threading.Thread(target=self._run, args=(started,), daemon=True, name="grasp3d")
        thread.start()
        started.result(PATIENCE)

    @property
    def address(self) -> str:
        """Where it is reached from the same machine."""
        return address_of(HOST, self._listener)

    @property
    def port(self) -> int:
        """At which port."""
        return int(self._listener.getsockname()[1])

    def offer(self, album: Album, settings: ViewSettings) -> str:
        """Offer something to look at; returns its path."""
        return self._door.offer(album, settings)

    def let_in_by_name(self) -> None:
        """Serve visitors who come through a proxy, under whatever name it has."""
        self._door.guarded = False

    def _run(self, started: "Future[None]") -> None:
        async def forever() -> None:
            async with opened(self._door, self._listener):
                started.set_result(None)
                await asyncio.Event().wait()

        try:
            asyncio.run(forever())
        except Exception as error:  # noqa: BLE001
            if not started.done():
                started.set_exception(error)


@cache
def server() -> Server:
    """The one server of this process; started when it is first asked for."""
    return Server()


def _base(proxy: str | None) -> str:
    """What stands before the path of a page."""
    if proxy is None and HUB in os.environ:
        proxy = os.environ[HUB].rstrip("/") + "/proxy/"
    if proxy is None:
        return server().address
    server().let_in_by_name()
    return f"{proxy.rstrip('/')}/{server().port}/"


def _still(album: Album, settings: ViewSettings) -> Shown:
    """A picture of how it would first be shown.

    Raises:
        OutputError: There is no OpenGL.
    """
    data = io.BytesIO()
    with import_module("grasp3d.viewer.scene.pictures").opened(album, settings, ignore) as studio:
        Image.fromarray(studio.shot()).save(data, "PNG")
    coded = base64.b64encode(data.getvalue()).decode()
    name = html.escape(album.exhibits[0].name)
    return Shown(
        f'<img src="data:image/png;base64,{coded}" alt="Surface of {name}" '
        f'style="max-width: 100%"><p>{MORE}</p>'
    )
