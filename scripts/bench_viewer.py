"""How fast the viewer answers on a large mesh: a move of a slider, a click.

The mug of the library is divided until it has so many vertices. A move is the session's change,
the new picture on the surface, and all that is told beside it; a click is finding the vertex,
telling of it and marking its grasp. VTK's own time to draw is printed apart: without a graphics
card it is most of the time, with one it is little.

    python scripts/bench_viewer.py [--vertices 100000] [--moves 60] [--clicks 60]
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from grasp3d import SurfaceLabels, label_surface, load_mesh
from grasp3d.rendering import choose_window
from grasp3d.viewer.scene.scene import Scene, new_plotter
from grasp3d.viewer.session.album import album_of
from grasp3d.viewer.session.painting import picture
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.telling import tell
from grasp3d.viewer.view_settings import ViewSettings

MUG = Path(__file__).parents[1] / "meshes" / "mug.glb"
MOVE, CLICK = 50.0, 100.0
"""What is asked for [ms]."""

Times = dict[str, list[float]]


def labelled(vertices: int) -> SurfaceLabels:
    """Label the mug with at least so many vertices."""
    coarse = load_mesh(MUG)
    edge = coarse.size / 32.0 * 1.2 * (len(coarse.vertices) / vertices) ** 0.5
    mesh = load_mesh(MUG, max_edge=edge)
    while len(mesh.vertices) < vertices:
        edge *= 0.97
        mesh = load_mesh(MUG, max_edge=edge)
    return label_surface(mesh)


def timed(times: Times, name: str, do: Callable[[], object]) -> None:
    """Add to the times what something takes [ms]."""
    begun = time.perf_counter()
    do()
    times.setdefault(name, []).append(1e3 * (time.perf_counter() - begun))


def moved(session: Session, scene: Scene, count: int) -> Times:
    """Move the slider of the friction to and fro."""
    times: Times = {}
    for step in range(count):
        friction = 0.3 + 0.2 * (step % 40) / 40.0

        def move(friction: float = friction) -> None:
            session.change(friction=friction)
            scene.update(session)
            tell(session)

        timed(times, "move of a slider", move)
        timed(times, "VTK's drawing after it", scene.plotter.render)
        subject = session.subject
        assert subject is not None
        timed(times, "of it: picture", lambda s=subject: picture(s, "label", session.model))
        timed(times, "of it: words", lambda: tell(session))
    return times


def clicked(session: Session, scene: Scene, count: int) -> Times:
    """Click on places all over the window, those beside the object left out."""
    times: Times = {}
    random = np.random.default_rng(0)
    width, height = scene.plotter.window_size
    while len(times.get("click", ())) < count:
        x, y = random.uniform((0.0, 0.0), (width, height))
        if scene.pick(session, x, y) is None:
            continue

        def click(x: float = x, y: float = y) -> None:
            session.tap(scene.pick(session, x, y))
            scene.update(session)
            tell(session)

        both: Times = {}
        timed(times, "click", click)
        timed(both, "drawing", scene.plotter.render)
        times.setdefault("click, drawn", []).append(times["click"][-1] + both["drawing"][0])
    return times


def report(times: Times, asked: dict[str, float]) -> None:
    """Print medians and worst, and how they compare with what is asked."""
    table = Table(
        "",
        "least [ms]",
        "median [ms]",
        "worst [ms]",
        "asked [ms]",
        "median / asked",
        "worst / asked",
    )
    for name, taken in times.items():
        median, worst, limit = float(np.median(taken)), max(taken), asked.get(name)
        ratios = (f"{limit:g}", f"{median / limit:.2f}", f"{worst / limit:.2f}") if limit else ()
        table.add_row(name, f"{min(taken):.1f}", f"{median:.1f}", f"{worst:.1f}", *ratios)
    Console(width=110).print(table)


def main() -> None:
    """Take the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vertices", type=int, default=100_000)
    parser.add_argument("--moves", type=int, default=60)
    parser.add_argument("--clicks", type=int, default=60)
    options = parser.parse_args()
    choose_window()
    labels = labelled(options.vertices)
    session = Session(album_of(labels), ViewSettings())
    while session.working is not None:
        session.poll()
        time.sleep(0.01)
    plotter = new_plotter(session.settings, off_screen=True)
    scene = Scene(plotter)
    scene.update(session)
    scene.shot()
    times = moved(session, scene, options.moves) | clicked(session, scene, options.clicks)
    width, height = plotter.window_size
    print(f"{len(labels.mesh.vertices):,} vertices, {width} x {height} pixels")
    report(times, {"move of a slider": MOVE, "click": CLICK, "click, drawn": CLICK})
    plotter.close()


if __name__ == "__main__":
    main()
