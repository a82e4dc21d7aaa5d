import {
  BackSide, ConeGeometry, CylinderGeometry, Group, Mesh, MeshBasicMaterial, Quaternion, SphereGeometry, Vector3,
} from "three";

// Lengths are relative to the object's size.
const BALL = 0.014;
const ROD = 0.005;
const ARROW = { length: 0.2, head: 0.05, headRadius: 0.017, shaft: 0.0065 };
const RIM = 0.004;
const UP = new Vector3(0, 1, 0);
const HIDDEN_OPACITY = 0.5;

/** Points where the arrows of a grasp begin: outside the object, along the outward normals. */
export function arrowTails(contacts, normals, size) {
  return contacts.map((contact, number) => contact.clone().addScaledVector(normals[number], ARROW.length * size));
}

/**
 * Contacts as balls, with an arrow along each inward normal if the normals are known, else with
 * lines between them; outlined to be visible on any background, and hidden parts transparent.
 */
export function graspMarks({ contacts, normals }, size, { core, rim }) {
  const group = new Group();
  const add = (shape, setPose) => {
    for (const [extra, order, options] of [
      [0, 1, { color: core }],
      [RIM * size, 1, { color: rim, side: BackSide }],
      [0, 2, { color: core, depthTest: false, transparent: true, opacity: HIDDEN_OPACITY }],
    ]) {
      const part = new Mesh(shape(extra), new MeshBasicMaterial(options));
      setPose(part);
      part.renderOrder = order;
      group.add(part);
    }
  };
  const between = (from, to, shape) => {
    const along = to.clone().sub(from);
    add((extra) => shape(along.length() + extra, extra), (part) => {
      part.position.copy(from).addScaledVector(along, 0.5);
      part.quaternion.copy(new Quaternion().setFromUnitVectors(UP, along.clone().normalize()));
    });
  };
  for (const contact of contacts) {
    add((extra) => new SphereGeometry(BALL * size + extra, 20, 14), (part) => part.position.copy(contact));
  }
  const rod = (radius) => (length, extra) => new CylinderGeometry(radius * size + extra, radius * size + extra, length, 12);
  if (normals) {
    const tails = arrowTails(contacts, normals, size);
    contacts.forEach((contact, number) => {
      const tip = contact.clone().addScaledVector(normals[number], BALL * size);
      const neck = tip.clone().addScaledVector(normals[number], ARROW.head * size);
      between(tails[number], neck, rod(ARROW.shaft));
      between(neck, tip, (length, extra) => new ConeGeometry(ARROW.headRadius * size + 1.6 * extra, length + 2 * extra, 24));
    });
  } else {
    const pairs = contacts.map((contact, number) => [contact, contacts[(number + 1) % contacts.length]]);
    for (const [from, to] of contacts.length > 2 ? pairs : pairs.slice(1)) between(from, to, rod(ROD));
  }
  return group;
}

export function disposeMarks(group) {
  for (const part of group.children) {
    part.geometry.dispose();
    part.material.dispose();
  }
}
