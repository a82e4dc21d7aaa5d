"""Measure the viewer's response times on a large mesh: moving sliders, clicking.

The mug of the library is refined to a number of vertices. A move consists of changing the session,
updating the surface's colours and the panel's texts: of the friction, while nothing else is
uncertain; then of the friction error and of the location error, while friction, normals and
locations are uncertain. A click consists of finding the vertex, inspecting it and marking its
grasp. VTK's rendering time is printed separately: it dominates without a graphics card.

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
from grasp3d.rendering.opengl import choose_window
from grasp3d.viewer.scene.scene import Scene, new_plotter
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.session.painting import texture_image
from grasp3d.viewer.session.panel_text import panel_text
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import ViewSettings

MUG = Path(__file__).parents[1] / "meshes" / "mug.glb"
MOVE, CLICK = 50.0, 100.0
"""Largest acceptable times [ms]."""

Times = dict[str, list[float]]


def labelled(vertices: int) -> SurfaceLabels:
    """Label the mug with at least a number of vertices."""
    coarse = load_mesh(MUG)
    edge = coarse.size / 32.0 * 1.2 * (len(coarse.vertices) / vertices) ** 0.5
    mesh = load_mesh(MUG, max_edge=edge)
    while len(mesh.vertices) < vertices:
        edge *= 0.97
        mesh = load_mesh(MUG, max_edge=edge)
    return label_surface(mesh)


def timed(times: Times, name: str, run: Callable[[], object]) -> None:
    """Add the duration of a call [ms]."""
    start = time.perf_counter()
    run()
    times.setdefault(name, []).append(1e3 * (time.perf_counter() - start))


def measure_moves(session: Session, scene: Scene, count: int) -> Times:
    """Move the friction slider back and forth."""
    times: Times = {}
    for step in range(count):
        friction = 0.3 + 0.2 * (step % 40) / 40.0

        def move(friction: float = friction) -> None:
            session.change(friction=friction)
            scene.update(session)
            panel_text(session)

        timed(times, "move of a slider", move)
        timed(times, "rendering after it", scene.plotter.render)
        subject = session.subject
        assert subject is not None
        timed(times, "of it: colours", lambda s=subject: texture_image(s, "label", session.model))
        timed(times, "of it: texts", lambda: panel_text(session))
    return times


def measure_errors(session: Session, scene: Scene, count: int) -> Times:
    """Move the sliders of the friction error and of the location error back and forth."""
    times: Times = {}
    size = session.subject.size if session.subject else 1.0
    # Within the cone that was searched, and with the best grasps for this location error.
    session.change(friction=0.3, normal_error=0.02, location_error=0.01 * size)
    wait_until_idle(session)
    scene.update(session)
    for name, largest in (("friction_error", 0.17), ("location_error", 0.02 * size)):
        for step in range(count):
            value = largest * (1.0 + step % 40) / 40.0

            def move(name: str = name, value: float = value) -> None:
                session.change(**{name: value})
                scene.update(session)
                panel_text(session)

            timed(times, f"move of the {name.replace('_', ' ')}", move)
            scene.plotter.render()
    session.change(normal_error=0.0, friction_error=0.0, location_error=0.0)
    return times


def measure_clicks(session: Session, scene: Scene, count: int) -> Times:
    """Click on random points of the object."""
    times: Times = {}
    random = np.random.default_rng(0)
    width, height = scene.plotter.window_size
    while len(times.get("click", ())) < count:
        x, y = random.uniform((0.0, 0.0), (width, height))
        if scene.pick(session, x, y) is None:
            continue

        def click(x: float = x, y: float = y) -> None:
            session.click(scene.pick(session, x, y))
            scene.update(session)
            panel_text(session)

        rendering: Times = {}
        timed(times, "click", click)
        timed(rendering, "rendering", scene.plotter.render)
        total = times["click"][-1] + rendering["rendering"][0]
        times.setdefault("click and rendering", []).append(total)
    return times


def wait_until_idle(session: Session) -> None:
    """Wait for computations in the background."""
    while session.working is not None:
        session.poll()
        time.sleep(0.01)


def report(times: Times, limits: dict[str, float]) -> None:
    """Print the times and their ratios to the limits."""
    table = Table(
        "",
        "best [ms]",
        "median [ms]",
        "worst [ms]",
        "limit [ms]",
        "median / limit",
        "worst / limit",
    )
    for name, measured in times.items():
        median, worst, limit = float(np.median(measured)), max(measured), limits.get(name)
        ratios = (f"{limit:g}", f"{median / limit:.2f}", f"{worst / limit:.2f}") if limit else ()
        table.add_row(name, f"{min(measured):.1f}", f"{median:.1f}", f"{worst:.1f}", *ratios)
    Console(width=110).print(table)


def main() -> None:
    """Measure and print all times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vertices", type=int, default=100_000)
    parser.add_argument("--moves", type=int, default=60)
    parser.add_argument("--clicks", type=int, default=60)
    options = parser.parse_args()
    choose_window()
    labels = labelled(options.vertices)
    session = Session(collection_of(labels), ViewSettings())
    wait_until_idle(session)
    plotter = new_plotter(session.settings, off_screen=True)
    scene = Scene(plotter)
    scene.update(session)
    scene.screenshot()
    times = measure_moves(session, scene, options.moves)
    times |= measure_errors(session, scene, options.moves)
    wait_until_idle(session)
    times |= measure_clicks(session, scene, options.clicks)
    width, height = plotter.window_size
    print(f"{len(labels.mesh.vertices):,} vertices, {width} x {height} pixels")
    limits = dict.fromkeys((name for name in times if name.startswith("move")), MOVE)
    report(times, {**limits, "click": CLICK, "click and rendering": CLICK})
    plotter.close()


if __name__ == "__main__":
    main()
