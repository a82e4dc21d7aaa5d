import {
  BufferAttribute, BufferGeometry, ConeGeometry, CylinderGeometry, DoubleSide, EdgesGeometry, Group, LineBasicMaterial, LineSegments, Matrix4, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, Quaternion, Vector3,
} from "three";

// The colours and opacities of the interactive viewer.
const PARTS = {
  palm: { color: 0x5a626b, opacity: 0.3 },
  finger: { color: 0x8a939c, opacity: 0.7 },
  pad: { color: 0x2b2f33, opacity: 0.9 },
  tip: { color: 0x2b2f33, opacity: 0.9 },
};
const TABLE = { color: 0xc9c4ba, opacity: 0.6 };
const ARC = { color: 0x0072b2, opacity: 0.4 };
const ARC_RADIUS = 0.95; // of the fingers' length
const ARC_INNER = 0.35; // of the outer radius
const ARC_STEP = Math.PI / 60;
const ARROW = { tail: 1.6, tip: 0.15, head: 0.35, headRadius: 0.12, shaft: 0.04, hidden: 0.4 }; // distances from the TCP in finger lengths, the others in lengths of the arrow
const EDGE_ANGLE = 40; // degrees
const EDGES = { light: 0x2b2f33, dark: 0xc3c9cf };

/** Triangles with a normal for each face, relative to the object's centre. */
function geometry(vertices, faces, centre) {
  const made = new BufferGeometry();
  const positions = Float32Array.from({ length: 3 * faces.length }, (_, at) => {
    const k = at % 3;
    return vertices[3 * faces[Math.floor(at / 3)] + k] - centre.getComponent(k);
  });
  made.setAttribute("position", new BufferAttribute(positions, 3));
  made.computeVertexNormals();
  return made;
}

function translucent(look, extra = {}) {
  return new MeshLambertMaterial({ ...look, transparent: true, depthWrite: false, ...extra });
}

/** The table below the object; null: there is none. */
export function tableMesh(object, centre) {
  const table = object.gripper?.table;
  if (!table) return null;
  return new Mesh(geometry(table.vertices, table.faces, centre), translucent(TABLE, { side: DoubleSide }));
}

/** Corners of the gripper at a grasp, in the frame of the mesh, one after the other. */
function placedVertices({ vertices, shifts }, grasp) {
  const pose = new Matrix4().set(...grasp.pose);
  const placed = new Float64Array(vertices.length);
  const point = new Vector3();
  for (let at = 0; at < vertices.length; at += 3) {
    point.set(vertices[at] + grasp.drawn_opening * shifts[at / 3], vertices[at + 1], vertices[at + 2]);
    point.applyMatrix4(pose).toArray(placed, at);
  }
  return placed;
}

/** A fan of the free approach angles about the closing axis, on the side of the palm. */
function arcMesh(gripper, grasp, centre) {
  const outer = ARC_RADIUS * gripper.fingers;
  const steps = Math.max(1, Math.ceil((2 * grasp.approach_margin) / ARC_STEP));
  const pose = new Matrix4().set(...grasp.pose);
  const vertices = [];
  for (let step = 0; step <= steps; step++) {
    const angle = grasp.approach_margin * ((2 * step) / steps - 1);
    for (const radius of [ARC_INNER * outer, outer]) {
      vertices.push(...new Vector3(0, radius * Math.sin(angle), -radius * Math.cos(angle)).applyMatrix4(pose).toArray());
    }
  }
  const faces = Array.from({ length: steps }, (_, step) => [0, 1, 3, 0, 3, 2].map((corner) => 2 * step + corner)).flat();
  const look = { ...ARC, transparent: true, depthWrite: false, side: DoubleSide };
  return new Mesh(geometry(vertices, faces, centre), new MeshBasicMaterial(look));
}

/** The arrow along the approach, faint where something is in front of it. */
function approachArrow(gripper, grasp, centre) {
  const pose = new Matrix4().set(...grasp.pose);
  const [tail, tip] = [ARROW.tail, ARROW.tip].map((at) => new Vector3(0, 0, -at * gripper.fingers).applyMatrix4(pose).sub(centre));
  const along = tip.clone().sub(tail);
  const length = along.length();
  const turn = new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), along.clone().normalize());
  const [shaft, head] = [(1 - ARROW.head) * length, ARROW.head * length];
  const shapes = [
    [new CylinderGeometry(ARROW.shaft * length, ARROW.shaft * length, shaft, 16), 0.5 * shaft],
    [new ConeGeometry(ARROW.headRadius * length, head, 24), shaft + 0.5 * head],
  ];
  const looks = [{ color: ARC.color }, { color: ARC.color, transparent: true, opacity: ARROW.hidden, depthTest: false }];
  return shapes.flatMap(([shape, at]) => looks.map((look) => {
    const part = new Mesh(shape, new MeshBasicMaterial(look));
    part.position.copy(tail).addScaledVector(along, at / length);
    part.quaternion.copy(turn);
    return part;
  }));
}

/** The gripper at a grasp: its meshes, and its corners; null: the grasp has no pose. */
export function gripperAt(object, grasp, centre, dark) {
  const { gripper } = object;
  if (!gripper || !grasp.pose.length) return null;
  const group = new Group();
  const placed = placedVertices(gripper, grasp);
  for (const [name, look] of Object.entries(PARTS)) {
    const faces = gripper.faces.filter((_, at) => gripper.parts[Math.floor(at / 3)] === name);
    if (!faces.length) continue;
    const shape = geometry(placed, faces, centre);
    group.add(new Mesh(shape, translucent(look)));
    const edges = new LineBasicMaterial({ color: dark ? EDGES.dark : EDGES.light });
    if (name !== "tip") group.add(new LineSegments(new EdgesGeometry(shape, EDGE_ANGLE), edges));
  }
  if (grasp.approach_margin > 0) group.add(arcMesh(gripper, grasp, centre));
  group.add(...approachArrow(gripper, grasp, centre));
  const corners = Array.from({ length: placed.length / 3 }, (_, at) => new Vector3().fromArray(placed, 3 * at).sub(centre));
  return { group, corners };
}
