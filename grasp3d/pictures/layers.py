"""What is drawn of a scene, one actor for each appearance, in the order in which they cover."""

from dataclasses import dataclass

import pyvista
from vtkmodules.vtkRenderingCore import vtkMapper

from grasp3d.hand.triangles import ARC_COLOR, TABLE_COLOR
from grasp3d.pictures.camera import AMBIENT, LIGHT, pixel_ratio

DEPTH_OFFSET = -60000.0
"""Depth offset that puts faint layers in front of the surface [units of depth]."""

FAINT = 0.4
"""Opacity of what is behind the surface."""

INK, WHITE, GREY, BLUE = "#1A1A1A", "#FFFFFF", "#4A5562", "#0072B2"
"""Colours of marks; blue is that of the safe cone, which no label has."""

INSIDE, EDGE, FRAME = "#8C857B", "#2B2F33", "#5B6470"
"""Colours of back faces, which are seen in a section or if a mesh is open; of the edges of hands;
and of the outline of a section."""


@dataclass(frozen=True)
class Look:
    """How a layer looks."""

    color: str | tuple[int, int, int] = "white"
    opacity: float = 1.0
    lit: bool = False
    """Whether its brightness depends on its direction."""
    culled: str = "none"
    """Faces that are not drawn: 'front', of rims around smaller marks, 'back' or 'none'."""
    width: float = 0.0
    """Of lines [pixels at 72 per inch]; 0: faces."""
    mark: bool = False
    """Whether it covers what was drawn before it, and is seen faintly where the surface is in front
    of it."""


LOOKS = {
    "surface": Look(lit=True, culled="back"),
    "excluded": Look(lit=True, culled="back"),
    "inside": Look(INSIDE, lit=True, culled="front"),
    "outline": Look(FRAME, width=1.5),
    "table": Look(TABLE_COLOR, 0.6, lit=True),
    "arc": Look(ARC_COLOR, 0.4),
    "gripper": Look(lit=True, culled="back"),
    "links": Look(lit=True, culled="back"),
    "edges": Look(EDGE, width=1.2),
    "halo": Look(width=4.0),
    "nominal rims": Look(GREY, width=2.0),
    "safe rims": Look(BLUE, width=2.5),
    "extreme cones": Look(INK, width=1.2),
    "cones": Look(GREY, 0.22, mark=True),
    "safe cones": Look(BLUE, 0.5, mark=True),
    "contacts rims": Look(INK, culled="front", mark=True),
    "contacts": Look(mark=True),
    "fixed rims": Look(culled="front", mark=True),
    "fixed": Look(INK, mark=True),
    "approach": Look(ARC_COLOR, mark=True),
}
"""All layers: those behind in the list cover those before them."""

SURFACES = ("surface", "excluded", "inside")
LINES = ("halo", "nominal rims", "safe rims", "extreme cones")
MARKS = (*LINES, *(name for name, look in LOOKS.items() if look.mark))
"""Layers of a grasp."""


class Layers:
    """The layers in one renderer."""

    def __init__(self, renderer: pyvista.Renderer) -> None:
        renderer.UseOITOff()  # marks cover those made before them
        self.renderer = renderer
        self.actors: dict[str, pyvista.Actor] = {}
        self._faint: dict[str, pyvista.Actor] = {}
        for name, look in LOOKS.items():
            if look.mark and not self._faint:
                marks = {other: one for other, one in LOOKS.items() if one.mark}
                self._faint = {other: self._actor(one, faint=True) for other, one in marks.items()}
            self.actors[name] = self._actor(look)
        for name in SURFACES:
            self.actors[name].prop.interpolation = "Phong"
            self.actors[name].PickableOn()
        renderer.background_color = pyvista.Color("white")
        renderer.remove_all_lights()
        renderer.add_light(pyvista.Light(position=LIGHT, light_type="camera light", intensity=1.0))

    def show(self, name: str, data: pyvista.PolyData | None) -> None:
        """Draw a layer; None: it is hidden."""
        for actor in filter(None, (self.actors[name], self._faint.get(name))):
            actor.visibility = data is not None
            if data is not None:
                actor.mapper.dataset = data
            if LOOKS[name].width:
                actor.prop.line_width = LOOKS[name].width * pixel_ratio(self.renderer)

    def hide(self) -> None:
        """Show nothing."""
        for name in LOOKS:
            self.show(name, None)

    def _actor(self, look: Look, *, faint: bool = False) -> pyvista.Actor:
        """An actor without content."""
        actor = pyvista.Actor(mapper=pyvista.DataSetMapper())
        actor.mapper.SetScalarVisibility(False)  # noqa: FBT003
        drawn = actor.prop
        drawn.color, drawn.lighting, drawn.culling = look.color, look.lit, look.culled
        drawn.opacity = look.opacity * (FAINT if faint else 1.0)
        drawn.ambient, drawn.diffuse = AMBIENT, 1.0 - AMBIENT
        if faint:
            vtkMapper.SetResolveCoincidentTopologyToPolygonOffset()
            actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, DEPTH_OFFSET)
        if look.mark:
            actor.ForceTranslucentOn()  # drawn in the order in which they are made
        actor.PickableOff()
        actor.VisibilityOff()
        self.renderer.AddActor(actor)
        return actor


def show_colors(actor: pyvista.Actor, name: str, *, of_points: bool) -> None:
    """Colour an actor by an array of its data: red, green, blue of points or of cells."""
    mapper = actor.mapper
    mapper.SetScalarVisibility(True)  # noqa: FBT003
    if of_points:
        mapper.SetScalarModeToUsePointFieldData()
    else:
        mapper.SetScalarModeToUseCellFieldData()
    mapper.SelectColorArray(name)
    mapper.SetColorModeToDirectScalars()
