"""Argument types of the kernels that Python calls, with which they are compiled ahead.

Whoever adds a kernel that Python calls adds a row to `SIGNATURES`. Arrays are contiguous; whether
one can be written to belongs to its type, and those of a mesh and of contacts cannot.
"""

from typing import Any

from numba import typeof
from numba.core import types

from grasp3d._kernels.forces import grip_force, sure_forces
from grasp3d._kernels.hands import kinematics, link_shapes, overlaps, touched_surface, touching
from grasp3d._kernels.hull import (
    critical_angle,
    frictionless_closure,
    pair_epsilon,
    wrench_problem,
    wrenches,
)
from grasp3d._kernels.hull.polytope import make_polytope
from grasp3d._kernels.hull.support_functions import TOTAL
from grasp3d._kernels.jaws import closing, gripper_parts, jaws, reaching
from grasp3d._kernels.search import (
    antipodal_candidates,
    coplanar_contacts,
    crease_contacts,
    descent,
    face_contacts,
    multifinger,
    multifinger_evaluation,
    multifinger_grasps,
    pair_angles,
    ranked_outcomes,
    rays,
    reachable_partners,
)
from grasp3d._kernels.surface import (
    box_tree,
    face_tree,
    first_faces,
    surface_contacts,
    visible_faces,
)


def _array(item: types.Type, ndim: int, *, readonly: bool = False) -> types.Array:
    return types.Array(item, ndim, "C", readonly=readonly)


def _tuple(kind: type | None, *fields: types.Type) -> Any:
    return types.BaseTuple.from_types(fields, kind)


_f, _i, _b, _i8, _u8, _u64 = (
    types.float64, types.int64, types.boolean, types.int8, types.uint8, types.uint64,
)  # fmt: skip
_f1, _f2, _f3, _f4 = (_array(_f, ndim) for ndim in range(1, 5))
_i1, _i2, _i3 = (_array(_i, ndim) for ndim in range(1, 4))
_b1, _i8_1, _i8_2, _u8_1, _u64_1 = (
    _array(item, ndim) for item, ndim in ((_b, 1), (_i8, 1), (_i8, 2), (_u8, 1), (_u64, 1))
)
_i32_1, _f32_1, _f32_2 = (
    _array(item, ndim) for item, ndim in ((types.int32, 1), (types.float32, 1), (types.float32, 2))
)
_fixed_f1, _fixed_f2, _fixed_f3 = (_array(_f, ndim, readonly=True) for ndim in range(1, 4))
_fixed_b1 = _array(_b, 1, readonly=True)
_fixed_i1, _fixed_i2 = (_array(_i, ndim, readonly=True) for ndim in range(1, 3))

# Wrenches, epsilon and forces.
_FORM, _FORCE_FORM = _tuple(None, _i, _b, _i), _tuple(None, _i, _b, _i, _i)
_GOAL = types.UniTuple(_f, 4)
_WORKSPACE = typeof(wrench_problem.make_workspace(TOTAL, 2))
_POLYTOPE = typeof(make_polytope(1))
_RESULTS = _tuple(wrench_problem.Results, _f1, _f1, _i1, _u8_1, _b1, _f2, _f3, _f1)
_BRACKET = typeof(critical_angle.no_bracket())
_TASK = typeof(grip_force.make_scratch(1, 2))
_FORCES = _tuple(grip_force.ForceResults, _f1, _f1, _i1, _u8_1, _u8_1, _f2, _f3)
_CONTACTS, _HELD = (_FORM, _f4, _f2, _f3), (_FORCE_FORM, _f4, _f2, _f3)

# Surfaces.
_SURFACE = _tuple(surface_contacts.Surface, _fixed_f2, _fixed_i2, _fixed_i2, _fixed_f2, _i3)
_SETS = _tuple(surface_contacts.ContactNormals, _fixed_i1, _fixed_i1, _fixed_f2)
_FACE_TREE = _tuple(face_tree.FaceTree, _i1, _i, _f2)
_BOX_TREE = _tuple(box_tree.BoxTree, _i, _i1, _f2, _f2)

# Searches.
_PAIR_LIMITS = _tuple(antipodal_candidates.PairLimits, *[_f] * 2)
_PAIRS = _tuple(
    antipodal_candidates.BestPairs, _f1, _f1, _f2, _f2, _f2, _f2, _i2, _f3, _i8_1, _i8_1, _u8_1,
    _f3, _f2, _i8_2, _f,
)  # fmt: skip
_DOMAIN = _tuple(face_contacts.PairDomain, _SURFACE, _SETS, _fixed_f2, _FACE_TREE, _PAIR_LIMITS)
_RAYS = _tuple(rays.Rays, _i32_1, _f2, _i8_1, _f1, _f1, _i32_1)
_ORIGINS = _tuple(
    rays.Origins, _fixed_f2, _SETS, _fixed_f2, _f2, _fixed_f1, types.UniTuple(_i1, 2), _f
)
_PLANE = typeof(coplanar_contacts.make_plane())
_POINTS = _tuple(multifinger_grasps.CandidatePoints, _i, _f2, _i1, _f2, _fixed_f2, _i1)
_FINGERS = (
    _i, _i1, _i,
    _tuple(
        multifinger_grasps.ContactDomain, _SURFACE, _SETS, _i2, _i1, _f2, _i1, _i1, _b, _i, _POINTS
    ),
    _tuple(multifinger_grasps.SearchLimits, *[_f] * 6, _i, _f, _f, _b),
    _i, _f, _i,
    *[typeof(multifinger_grasps.make_best_grasps(1, 1))] * 2,
    typeof(multifinger_grasps.make_search_workspace(3, 1, 1)), _PLANE,
)  # fmt: skip

# Grippers.
_LIMITS = _tuple(gripper_parts.ApproachLimits, _f1, _f, _f1, _f)
_GRIPPER = _tuple(gripper_parts.GripperShape, *[_f] * 12)
_REACH_WORKSPACE = typeof(gripper_parts.make_workspace(1))
_BESIDE = _tuple(None, _GRIPPER, _LIMITS, _BOX_TREE, _REACH_WORKSPACE)
_JAW = _tuple(jaws.Jaw, _f2, _f3, _f1, *[_f] * 5)
_CLOSED = _tuple(closing.ClosedOn, _f3, _i2, _f2, _f3, _f3, _f2, _f3, _f4)
_REACHED = typeof(gripper_parts.no_results(1))

# Hands with joints.
_BODIES = _tuple(
    link_shapes.LinkShapes, _i1, _i1, _f3, _f2, _f2,
    _tuple(link_shapes.Hulls, _f2, _i1, _i1, _i1), _i1, _f2, _i1, _f2,
)  # fmt: skip
_TOUCHED = _tuple(
    touched_surface.TouchedSurface, _BOX_TREE, _f32_2, _b, _i2, _i2, _f2, _f2, _f1, _f1, _f,
    _array(types.float32, 3), _array(types.int32, 3),
)  # fmt: skip
_TOUCHES = _tuple(touching.Touches, _f2, _f3, _i2, _f4)
_SHAPE_SCRATCH = typeof(link_shapes.make_shape_scratch())
_TOUCH_SCRATCH = _tuple(
    touching.TouchScratch, _SHAPE_SCRATCH, _i1, _f1, _f2, _f1, _f1, _f1, _f2, *[_f1] * 4, _f2, _i1
)
_CHAIN = _tuple(
    kinematics.Chain, _fixed_i1, _fixed_i1, _fixed_f3, _fixed_f2, _fixed_f2, _fixed_i1, _fixed_f1,
    _fixed_f1,
)  # fmt: skip

SIGNATURES: dict[Any, list[tuple[types.Type, ...]]] = {
    # Those that take longest come first, so that processes end at the same time.
    closing.close_on: [(_SURFACE, _FACE_TREE, _f3, _f1, _f, _JAW, _i, _i, _CLOSED)],
    grip_force.task_forces: [
        (*_HELD, *[_f2] * 3, _f1, _f, _f1, _f, _i, _WORKSPACE, _POLYTOPE, _TASK, _FORCES),
    ],
    wrench_problem.epsilons: [
        (
            *_CONTACTS,
            _f2,
            _f,
            _GOAL,
            _b,
            _i,
            _i,
            dims,
            _BRACKET,
            _WORKSPACE,
            _POLYTOPE,
            _RESULTS,
        )
        for dims in (types.UniTuple(_i, 6), _i1)
    ],
    multifinger.search_fingers: [
        (*_FINGERS, typeof(multifinger_evaluation.make_hull_scratch(4))),
        (*_FINGERS, types.none),
    ],
    reachable_partners.keep_reached: [
        (_i1, _i8_1, _i1, _f2, _DOMAIN, _BESIDE, _PAIRS, _REACHED),
    ],
    descent.descend_exactly: [(_i1, _b, _i1, _f, _DOMAIN, _PAIRS)],
    descent.descend: [(_i1, _b, _f, _f, _DOMAIN, _PAIRS)],
    pair_epsilon.pair_epsilons: [
        (*_CONTACTS, _f, typeof(pair_epsilon.make_pair_scratch()), _RESULTS, _b1),
    ],
    reaching.reach_pairs: [
        (_f3, _f3, _i8_1, _GRIPPER, _LIMITS, _b, _BOX_TREE, _REACH_WORKSPACE, _u8_1, _u64_1, _f2),
    ],
    rays.evaluate_crossings: [
        (_i, _i32_1, _f32_1, _RAYS, _SURFACE, _SETS, _PAIR_LIMITS, _PAIRS),
    ],
    grip_force.wrench_forces: [(*_HELD, _f2, _f2, _f1, _f, _WORKSPACE, _f2, _FORCES)],
    sure_forces.write_sure_forces: [
        (_b, _fixed_f3, _fixed_f3, _fixed_f2, _f2, _f2, _f1, _f1, _f3, _f3),
    ],
    reachable_partners.search_reachable: [
        (_i1, _b, _f1, _f, _f, _i, _DOMAIN, _BESIDE),
    ],
    frictionless_closure.frictionless_depth: [
        (_f3, _i, _f, _i, typeof(frictionless_closure.make_cells(3))),
    ],
    rays.seed_rays: [(_i1, _i, types.UniTuple(_i, 2), _i, _ORIGINS, _PAIRS)],
    surface_contacts.order_normal_sets: [(_i1, _f2, _i1, _f2, _f1)],
    reaching.collide_poses: [
        (_f3, _f1, _i8_1, _b, _i, _GRIPPER, _LIMITS, _BOX_TREE, _REACH_WORKSPACE, _b1),
    ],
    crease_contacts.bound_creases: [(_FACE_TREE, _i1, _SURFACE, _SETS)],
    visible_faces.draw_surface: [(_f2, _fixed_i2, _u8_1, _fixed_i2, _f2, _b, _f2, _f, _f3)],
    face_tree.face_tree: [(_SURFACE,)],
    reachable_partners.explain_pairs: [(_i1, _i8_1, _i1, _f2, _DOMAIN, _BESIDE, _u8_1)],
    pair_angles.pair_angles: [(_f3, _i1, _i1, _f2, _f2, _f2)],
    box_tree.box_tree: [(_fixed_f2, _fixed_i2)],
    box_tree.nearest_faces: [(_f2, _f, _i, _i, _BOX_TREE, _i1)],
    first_faces.first_faces: [(_f32_2, _f32_2, _f32_1, _i, _i, _BOX_TREE, _i32_1, _f32_1)],
    rays.exploring_rays: [(_i1, _f, _f, _ORIGINS, _PAIRS)],
    wrench_problem.verify: [(_FORM, _f3, _f1, _f2, _f2, _f, _WORKSPACE, _f2, _f2)],
    rays.refining_rays: [(_i1, _f1, _f, _ORIGINS, _PAIRS)],
    rays.neighbour_rays: [(_i1, _ORIGINS, _PAIRS)],
    coplanar_contacts.critical_of_sets: [(_f3, _i2, _i2, _f2, _f, _PLANE, _f1, _f1)],
    coplanar_contacts.critical_of_three: [(_f3, _fixed_f3, _f, _PLANE, _f1)],
    reaching.reach_tips: [(_f3, _f3, _GRIPPER, _LIMITS, _BOX_TREE, _REACH_WORKSPACE, _u8_1)],
    pair_angles.scan: [(_f1, _fixed_f2, _fixed_f2, _SETS, _f1, _f1, _i8_1)],
    surface_contacts.write_normals_of_all: [(_i1, _f2, _SURFACE, _SETS, _i1, _i1, _f3)],
    wrenches.write_axes: [(_fixed_f2, _fixed_f2, _fixed_f1, _f, _f, _f3)],
    wrenches.span: [(_f2, _f, _f2, _f2)],
    surface_contacts.largest_angle: [(_fixed_f2, _i, _i, _f, _f, _f)],
    surface_contacts.smallest_angle: [(_fixed_f2, _i, _i, _f, _f, _f)],
    rays.starting_rays: [(_i32_1, _f2, _i8_1, _i)],
    rays.write_rays: [(_i, _RAYS, _fixed_f2, _f32_2, _f32_2)],
    touching.touch: [
        (_f4, _f, _f, _i, _i, _BODIES, _TOUCHED, _TOUCHES, _TOUCH_SCRATCH),
    ],
    touched_surface.fill_grid: [(_TOUCHED,)],
    overlaps.self_overlaps: [(_f4, _i, _i, _i2, _BODIES, _f1, _i2)],
    kinematics.link_poses: [(_f2, _CHAIN)],
    kinematics.jacobians: [(_f4, _i1, _i1, _f2, _i, _CHAIN)],
    ranked_outcomes.rank_outcomes: [(_i1, _i1, held, _i1) for held in (_b1, _fixed_b1)],
}
"""Kernels, and for each the types of its arguments in every way that it is called."""
