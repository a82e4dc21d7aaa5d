import { BackSide, CylinderGeometry, Group, Mesh, MeshBasicMaterial, Quaternion, SphereGeometry, Vector3 } from "three";

const BALL = 0.013;
const ROD = 0.0035;
const UP = new Vector3(0, 1, 0);
const THROUGH = 0.4;
const RIM = 1.3;

/**
 * Contacts as balls and the lines between them, with a rim that shows on any ground; what is hidden
 * shines through.
 */
export function graspMarks(contacts, size, { core, rim }) {
  const group = new Group();
  const add = (shape, radius, place) => {
    for (const [grown, order, options] of [
      [1, 1, { color: core }],
      [RIM, 1, { color: rim, side: BackSide }],
      [1, 2, { color: core, depthTest: false, transparent: true, opacity: THROUGH }],
    ]) {
      const part = new Mesh(shape(grown * radius * size), new MeshBasicMaterial(options));
      place(part);
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
