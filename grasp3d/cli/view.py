"""The command `grasp3d view`: shows an object in a window, in a browser, or as a picture."""

from grasp3d.cli.commands import View
from grasp3d.cli.report import Report
from grasp3d.errors import SettingError
from grasp3d.grasps.evaluated_poses import ranked_rows
from grasp3d.grasps.evaluation import evaluate_poses, poses_on
from grasp3d.hand.scene import Scene
from grasp3d.pictures.opengl import check_rendering
from grasp3d.system.context import refuse_warnings
from grasp3d.viewer.collection import Collection, collection_of_grasps, open_collection
from grasp3d.viewer.screenshots import check_picture, save_picture
from grasp3d.viewer.session import Session
from grasp3d.viewer.window import display_problem, show_window


def run(command: View, report: Report) -> int:
    """Run the command, and return the exit code."""
    problem, collection = _check(command), _collection(command, report)
    first = collection.items[0]
    with report.progress(f"opening {first.name}"):
        refuse_warnings(first.open().notes)
    if command.screenshot:
        with report.progress(f"rendering {command.screenshot.name}"):
            save_picture(collection, command.view, command.screenshot)
        report.written(command.screenshot)
    if command.web or problem:
        from grasp3d.viewer.page import serve

        def ready(address: str) -> None:
            shows = f"{address} shows {command.target.name}; Ctrl+C stops it"
            report.lines(["; ".join(filter(None, (problem, shows)))])

        serve(Session(collection, command.view), ready=ready)
    elif not command.screenshot:
        show_window(Session(collection, command.view))
    return 0


def _collection(command: View, report: Report) -> Collection:
    """Open the objects, or evaluate the poses, to view."""
    model, load = command.model, command.load.chosen
    if command.grasps is None:
        return open_collection(
            command.target, model, command.sampling, command.mesh, force=command.force,
            reach=command.reach, load=load,
        )  # fmt: skip
    if command.reach.hand is None:
        raise SettingError("--grasps needs the gripper or hand of the poses: give --hand NAME|FILE")
    hand = command.reach.hand
    poses, mesh = poses_on(command.grasps, command.target, command.mesh, hand=hand)
    scene = Scene.of(command.reach, mesh)
    assert scene is not None
    with report.progress(f"evaluating {command.grasps.name}"):
        results = evaluate_poses(mesh, poses, command.reach.touching(model), scene, load=load)
    return collection_of_grasps(results.take(ranked_rows(results)))


def _check(command: View) -> str:
    """Check before the work begins that the output is possible.

    Returns:
        Reason why no window can be opened; empty if one can, or is not needed.
    """
    if command.screenshot:
        check_picture(command.screenshot)
        command.check_output(command.screenshot)
    needs_window = not (command.web or command.screenshot)
    problem = display_problem() if needs_window else ""
    if command.web or problem:
        check_rendering()
    return problem
