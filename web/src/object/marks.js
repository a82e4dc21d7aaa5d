import { BackSide, CylinderGeometry, Group, Mesh, MeshBasicMaterial, Quaternion, SphereGeometry, Vector3 } from "three";

const BALL = 0.013;
const ROD = 0.0035;
const UP = new Vector3(0, 1, 0);
const HIDDEN_OPACITY = 0.4;
const RIM = 1.3;

/**
 * Contacts as balls with lines between them, outlined to be visible on any background; hidden parts
 * are transparent.
 */
export function graspMarks(contacts, size, { core, rim }) {
  const group = new Group();
  const add = (shape, radius, setPose) => {
    for (const [scale, order, options] of [
      [1, 1, { color: core }],
      [RIM, 1, { color: rim, side: BackSide }],
      [1, 2, { color: core, depthTest: false, transparent: true, opacity: HIDDEN_OPACITY }],
    ]) {
      const part = new Mesh(shape(scale * radius * size), new MeshBasicMaterial(options));
      setPose(part);
      part.renderOrder = order;
      group.add(part);
    }
  };
  for (const contact of contacts) {
    add((radius) => new SphereGeometry(radius, 20, 14), BALL, (part) => part.position.copy(contact));
  }
  const pairs = contacts.map((contact, number) => [contact, contacts[(number + 1) % contacts.length]]);
  for (const [from, to] of contacts.length > 2 ? pairs : pairs.slice(1)) {
    const along = to.clone().sub(from);
    add((radius) => new CylinderGeometry(radius, radius, along.length(), 10), ROD, (part) => {
      part.position.copy(from).addScaledVector(along, 0.5);
      part.quaternion.copy(new Quaternion().setFromUnitVectors(UP, along.clone().normalize()));
    });
  }
  return group;
}

export function disposeMarks(group) {
  for (const part of group.children) {
    part.geometry.dispose();
    part.material.dispose();
  }
}
