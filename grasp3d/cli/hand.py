"""The command `grasp3d hand`: prints the description of a gripper, draws and writes it."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import LengthOption, OutputFile, Overwrite, Quiet
from grasp3d.errors import SettingError

if TYPE_CHECKING:
    from grasp3d.hand.parallel_gripper import ParallelGripper

_NAME = tyro.conf.arg(metavar="[NAME|FILE]", help_behavior_hint="")
_LINKS = tyro.conf.arg(metavar="LINK LINK", help_behavior_hint="")
_LINK = tyro.conf.arg(metavar="LINK", help_behavior_hint="")


@dataclass(frozen=True)
class Hand:
    """Print the lengths, frame, force and touch of a gripper; draw it, write it as JSON.

    Without a gripper: list the ones that are known by name.
    """

    hand: Annotated[str, tyro.conf.Positional, _NAME] = ""
    """Name of a preset; or a file: JSON, as this command writes it, URDF (.urdf) or a MuJoCo model
    (.xml, .mjcf)."""

    fingers: Annotated[tuple[str, str] | None, _LINKS] = None
    """URDF and MuJoCo: names of the links, or bodies, of the two fingers."""

    palm: Annotated[str | None, _LINK] = None
    """URDF and MuJoCo: name of the link that is the palm (default: the one that carries the
    fingers)."""

    tcp: LengthOption = None
    """URDF and MuJoCo: from the origin of the link that carries the fingers to the tool centre
    point, a length with a unit, or in m (default: to the middle of the pads)."""

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """JSON file for the gripper."""

    picture: OutputFile = None
    """Picture of the gripper with its frame and dimensions (.png, .svg or .pdf)."""

    overwrite: Overwrite = False

    quiet: Quiet = False

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import hand_report

        if not self.hand:
            self._check_nothing_else()
            if not self.quiet:
                hand_report.print_presets()
            return 0
        self._check_outputs()
        gripper = self._described()
        written = self._write(gripper)
        if not self.quiet:
            hand_report.print_gripper(gripper, written)
        return 0

    def _check_nothing_else(self) -> None:
        options = ("fingers", "palm", "tcp", "output", "picture")
        given = [name for name in options if getattr(self, name) is not None]
        if given:
            raise SettingError(f"--{given[0]} needs a gripper: a name or a file before the options")

    def _check_outputs(self) -> None:
        from grasp3d.cli.existing_files import check_replaceable
        from grasp3d.plots.formats import METADATA
        from grasp3d.system.files import check_suffix

        for path, suffixes, what in (
            (self.output, [".json"], "gripper"), (self.picture, METADATA, "figure"),
        ):  # fmt: skip
            if path is not None:
                check_suffix(path, suffixes, what)
                # The description that was read may be replaced only when that is asked for.
                check_replaceable(path, overwrite=self.overwrite)

    def _described(self) -> "ParallelGripper":
        from grasp3d.hand.hand_files import read_hand
        from grasp3d.hand.parallel_gripper import ParallelGripper
        from grasp3d.settings.lengths import length_in_unit

        tcp = length_in_unit("tcp", self.tcp, "m")
        found = read_hand(self.hand, fingers=self.fingers, palm=self.palm, tcp=tcp)
        if not isinstance(found, ParallelGripper):
            raise SettingError(f"{found.name!r} is no parallel gripper; only those are described")
        return found

    def _write(self, gripper: "ParallelGripper") -> list[Path]:
        """Write the files that are asked for, and return their paths."""
        from grasp3d.hand.hand_files import write_hand
        from grasp3d.plots.formats import save_as
        from grasp3d.plots.grippers import gripper_figure

        if self.output is not None:
            write_hand(self.output, gripper)
        if self.picture is not None:
            save_as(gripper_figure(gripper), self.picture)
        return [path for path in (self.output, self.picture) if path is not None]
