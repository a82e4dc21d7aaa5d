"""Grippers that are known by name.

Makers state strokes and forces; the other lengths are measured on the geometry of published robot
descriptions. Fingers and palm are boxes around that geometry, but for exceptions that are stated.
All lengths are in metres.
"""

from difflib import get_close_matches

from grasp3d.errors import SettingError
from grasp3d.hand.parallel_gripper import ParallelGripper

SOFT_PADS = 0.002
"""Compliance of rubber pads of a few millimetres [m], which makers do not state: chosen so that the
rims of mugs, which such pads hold in practice, are within reach."""

FRANKA = ParallelGripper(
    name="franka",
    max_opening=0.080,
    finger_thickness=0.026,
    finger_width=0.021,
    finger_length=0.0462,
    pad_width=0.0174,
    pad_height=0.0176,
    inner_faces=(
        (
            (0.0, -0.0087, -0.0088),
            (0.0, 0.0087, -0.0088),
            (0.0, 0.0087, 0.0056),
            (0.0, 0.0058, 0.0087),
            (0.0, -0.0058, 0.0087),
            (0.0, -0.0087, 0.0056),
        ),
        (
            (0.0, -0.0087, -0.0088),
            (0.0, 0.0087, -0.0088),
            (-0.0026, 0.0104, -0.0449),
            (-0.0026, -0.0104, -0.0449),
        ),
    ),
    tip_thickness=0.0144,
    palm_thickness=0.208,
    palm_width=0.0633,
    palm_length=0.092,
    compliance=SOFT_PADS,
    max_force=70.0,
    base_to_tcp=0.1034,
    base_axes=("-y", "z"),
    joint_names=("panda_finger_joint1", "panda_finger_joint2"),
    joint_scale=(0.5, 0.5),
    joint_closed=(0.0, 0.0),
    source="Franka Hand data sheet; franka_description (URDF and collision meshes)",
)
"""Franka Hand, with its standard fingers.

* Stroke 80 mm, continuous force 70 N (140 N at most): data sheet.
* Hand's frame `panda_hand`; TCP 103.4 mm along its z, finger joints 58.4 mm along it, opening along
  its y, 40 mm each: URDF of franka_description.
* Collision mesh of a finger: 21.0 mm wide, 26 mm thick at its root (14.4 mm at the pad), up to
  112.2 mm along z; its flat pad is 17.4 mm wide and from 94.6 to 112.1 mm along z, with the
  corners at its end cut off. From there to 58.5 mm its inner side is inclined, and ends 2.6 mm
  behind the pad.
* Collision mesh of the hand: 63.3 mm wide, 104 mm to the farther side of it, from -25.9 to 66.0 mm
  along z.
"""

ROBOTIQ_2F85 = ParallelGripper(
    name="robotiq_2f85",
    max_opening=0.085,
    finger_thickness=0.030,
    finger_width=0.029,
    finger_length=0.045,
    pad_width=0.022,
    pad_height=0.0375,
    palm_thickness=0.1486,
    palm_width=0.075,
    palm_length=0.1138,
    compliance=SOFT_PADS,
    max_force=235.0,
    base_to_tcp=0.1373,
    base_axes=("y", "z"),
    joint_names=("finger_joint",),
    joint_scale=(-0.8 / 0.085,),
    joint_closed=(0.8,),
    source="Robotiq 2F-85 instruction manual; ROS-Industrial description (URDF, collision meshes)",
)
"""Robotiq 2F-85.

* Stroke 85 mm, force 20 to 235 N, 148.6 mm wide when open: instruction manual.
* Hand's frame `robotiq_arg2f_base_link`, fingers along its y, pads of 22 x 37.5 mm, body 75 mm wide
  from -2.7 mm along z: ROS-Industrial description.
* The linkage moves the pads on arcs: their centres are 130.3 mm along z when open and 144.3 mm when
  closed. The TCP is in the middle, so it may be up to 7 mm off along z.
* The fingers' boxes contain the linkage at all openings that were measured (finger_joint 0, 0.2,
  0.4, 0.6, 0.8) up to 45 mm behind the ends of the fingers; what lies behind is the palm.
* `finger_joint` [rad] is not linear in the opening. The line through its ends, 0.8 closed and 0
  open, is up to 3.5 mm of opening off, at half of the stroke.
"""

ROBOTIQ_2F140 = ParallelGripper(
    name="robotiq_2f140",
    max_opening=0.140,
    finger_thickness=0.033,
    finger_width=0.030,
    finger_length=0.065,
    pad_width=0.027,
    pad_height=0.065,
    palm_thickness=0.2026,
    palm_width=0.075,
    palm_length=0.1582,
    compliance=SOFT_PADS,
    max_force=125.0,
    base_to_tcp=0.187,
    base_axes=("y", "z"),
    joint_names=("finger_joint",),
    joint_scale=(-0.7 / 0.140,),
    joint_closed=(0.7,),
    source="Robotiq 2F-140 instruction manual; ROS-Industrial description (URDF, collision meshes)",
)
"""Robotiq 2F-140.

* Stroke 140 mm, force 10 to 125 N: instruction manual.
* Hand's frame `robotiq_arg2f_base_link`, fingers along its y, pads of 27 x 65 mm, widest 202.6 mm
  when open, body 75 mm wide from -3.7 mm along z: ROS-Industrial description, whose pads open to
  126 mm only.
* The linkage moves the pads on arcs: their centres are 175.2 mm along z when open and 198.9 mm when
  closed. The TCP is in the middle, so it may be up to 12 mm off along z.
* The fingers' boxes contain the linkage at the openings that were measured (finger_joint 0, 0.35,
  0.7), but for pins that stand out by 4.4 mm along y; what lies behind is the palm.
* `finger_joint` [rad] is taken as linear between 0.7 closed and 0 open. Measured openings are up to
  14 mm smaller, at the open end.
"""

WSG50 = ParallelGripper(
    name="wsg50",
    min_opening=0.0054,
    max_opening=0.110,
    finger_thickness=0.016,
    finger_width=0.030,
    finger_length=0.073,
    pad_width=0.020,
    pad_height=0.020,
    palm_thickness=0.146,
    palm_width=0.050,
    palm_length=0.0735,
    max_force=80.0,
    base_to_tcp=0.1365,
    joint_names=("wsg_50_base_joint_gripper_left", "wsg_50_base_joint_gripper_right"),
    joint_scale=(-0.5, 0.5),
    joint_closed=(0.0, 0.0),
    source="WSG 50-110 data sheet; ROS descriptions (body, joint limits); fingers as assumed there",
)
"""Schunk (Weiss Robotics) WSG 50-110.

* Stroke 110 mm, force 5 to 80 N: data sheet.
* Body 146 x 50 x 73.5 mm, finger joints from 2.7 to 55 mm each along x: ROS descriptions.
* Fingers are exchangeable. These are 73 mm long and 30 mm wide, as in grasp data sets with this
  gripper, and 16 mm thick, as in a published simulation model; pads of 20 x 20 mm are assumed.
  Measure your own.
"""

TACTILE = ParallelGripper(
    name="tactile",
    max_opening=0.100,
    finger_thickness=0.012,
    finger_width=0.012,
    finger_length=0.060,
    tip_radius=0.010,
    palm_thickness=0.130,
    palm_width=0.060,
    palm_length=0.080,
    max_force=40.0,
    receptive_field=0.004,
    base_to_tcp=0.140,
    source="tips of Wan & Howe 2018; all other lengths chosen",
)
"""A small gripper with tactile fingertips, which no maker sells.

* Hemispherical tips of 20 mm diameter with a receptive field of about 4 mm: Wan & Howe 2018. The
  sensor resolution is then 22.9 degrees; their 22.6 degrees are those of 3.95 mm.
* Stroke, fingers, palm and force are chosen to be those of a small gripper.
"""

PRESETS: dict[str, ParallelGripper] = {
    gripper.name: gripper for gripper in (FRANKA, ROBOTIQ_2F85, ROBOTIQ_2F140, WSG50, TACTILE)
}
"""The grippers by name."""

ALIASES = {"panda": "franka"}
"""Other names of presets."""


def preset(name: str) -> ParallelGripper:
    """A gripper that is known by name.

    Args:
        name: Its name or alias.

    Raises:
        SettingError: No preset has that name.

    Example:
        >>> from grasp3d.hand.presets import preset
        >>> preset("robotiq_2f85").max_opening
        0.085
        >>> preset("nope")
        Traceback (most recent call last):
            ...
        grasp3d.errors.SettingError: no gripper is called 'nope'; known: franka (panda), ...
    """
    key = ALIASES.get(name, name)
    if key in PRESETS:
        return PRESETS[key]
    near = get_close_matches(name, [*PRESETS, *ALIASES], 1)
    guess = f" (did you mean {near[0]}?)" if near else ""
    raise SettingError(f"no gripper is called {name!r}{guess}; known: {', '.join(preset_names())}")


def preset_names() -> list[str]:
    """Names of the presets, with their aliases in brackets."""
    others = {name: [alias for alias, of in ALIASES.items() if of == name] for name in PRESETS}
    return [f"{name} ({', '.join(more)})" if more else name for name, more in others.items()]
