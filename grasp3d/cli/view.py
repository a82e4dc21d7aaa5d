"""`grasp3d view`: view an object in a window, in a browser, or as a picture."""

from pathlib import Path
from typing import Any

from grasp3d.cli import progress_bars
from grasp3d.cli.commands import View
from grasp3d.cli.existing_files import check_output
from grasp3d.errors import GraspError, SettingError, WarningError
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.evaluation import evaluate_poses, poses_on
from grasp3d.grasps.hand_grasps import EvaluatedHandGrasps
from grasp3d.grasps.ranking import ranked_rows
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.scene import Scene
from grasp3d.system.context import refuse_warnings
from grasp3d.system.names import printable
from grasp3d.viewer.scene.pictures import check_picture, save_picture
from grasp3d.viewer.session.collection import (
    Collection,
    collection_of_grasps,
    open_collection,
)
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.window.display import display_problem


def run(command: View) -> int:
    """Run the command; returns the exit code."""
    problem = _check(command)
    collection = _opened(command)
    if command.screenshot:
        with progress_bars.progress(f"rendering {command.screenshot.name}", quiet=command.quiet):
            save_picture(collection, command.view, command.screenshot)
        _print(command, f"written: {command.screenshot}")
    if command.web or problem:
        _serve(command, collection, problem)
    elif not command.screenshot:
        from grasp3d.viewer.window.desktop import show_window

        show_window(Session(collection, command.view))
    return 0


def _collection(command: View) -> Collection:
    """The objects, or poses."""
    if command.grasps is not None:
        return collection_of_grasps(_poses(command, command.grasps))
    if command.contact_rule is not None:
        raise SettingError("contact_rule applies to poses of a hand with joints: give --grasps")
    return open_collection(
        command.target,
        command.model,
        command.sampling,
        command.mesh,
        force=command.force,
        reach=command.reach,
        load=command.load.chosen,
    )


def _poses(command: View, path: Path) -> EvaluatedPoses | EvaluatedHandGrasps:
    """Evaluate poses, the one to be taken first at the front."""
    hand, rules = command.reach.hand, dict[str, Any]()
    if hand is None:
        raise SettingError("grasps are poses of a gripper or hand: give it with --hand NAME|FILE")
    if command.contact_rule is not None:
        if not isinstance(hand, ArticulatedHand):
            raise SettingError("contact_rule applies to poses of a hand with joints")
        rules["contact_rule"] = command.contact_rule
    poses, mesh = poses_on(path, command.target, command.mesh, hand=hand)
    scene = Scene.of(command.reach, mesh)
    assert scene is not None
    with progress_bars.progress(f"evaluating {path.name}", quiet=command.quiet):
        model, load = command.reach.touching(command.model), command.load.chosen
        results = evaluate_poses(mesh, poses, model, scene, load=load, **rules)
    return results.take(ranked_rows(results))


def _opened(command: View) -> Collection:
    """The collection, with its first object opened."""
    collection = _collection(command)
    first = collection.items[0]
    try:
        with progress_bars.progress(f"opening {first.name}", quiet=command.quiet):
            refuse_warnings(first.open().notes)
    except GraspError as error:
        if len(collection.items) == 1 or isinstance(error, WarningError):
            raise  # with several objects the viewer shows the error of the first one
    return collection


def _check(command: View) -> str:
    """Check that the output is possible, before the work begins.

    Returns:
        Why no window can be opened; empty if one can, or is not needed.
    """
    if command.screenshot:
        check_picture(command.screenshot)
        check_output(command.screenshot, overwrite=command.overwrite)
    needs_window = not (command.web or command.screenshot)
    problem = display_problem() if needs_window else ""
    if command.web or problem:
        from grasp3d.viewer.web.page import check_page

        check_page(command.port)
    return problem


def _serve(command: View, collection: Collection, problem: str) -> None:
    """Serve the page; say first why no window was opened, if that is the reason."""
    from grasp3d.viewer.web.page import serve, uses_other_port

    def ready(address: str) -> None:
        note = f"{problem}; " if problem else ""
        note += f"{command.port} is in use; " if uses_other_port(address, command.port) else ""
        _print(command, f"{note}{address} shows {command.target.name}; Ctrl+C stops it")

    serve(collection, command.view, port=command.port, ready=ready)


def _print(command: View, line: str) -> None:
    if not command.quiet:
        print(printable(line), flush=True)  # noqa: T201
