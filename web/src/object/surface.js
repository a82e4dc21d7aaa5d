import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, MeshLambertMaterial } from "three";

/** Normal of each face [x, y, z], its length twice the face's area. */
function faceNormals(points, faces) {
  const normals = new Float64Array(faces.length);
  for (let start = 0; start < faces.length; start += 3) {
    const [a, b, c] = [3 * faces[start], 3 * faces[start + 1], 3 * faces[start + 2]];
    const u = [0, 1, 2].map((k) => points[b + k] - points[a + k]);
    const v = [0, 1, 2].map((k) => points[c + k] - points[a + k]);
    normals[start] = u[1] * v[2] - u[2] * v[1];
    normals[start + 1] = u[2] * v[0] - u[0] * v[2];
    normals[start + 2] = u[0] * v[1] - u[1] * v[0];
  }
  return normals;
}

/** Corners around each vertex, one list after the other, and where each list starts. */
function cornersAround(faces, count) {
  const starts = new Uint32Array(count + 1);
  for (const vertex of faces) starts[vertex + 1]++;
  for (let vertex = 0; vertex < count; vertex++) starts[vertex + 1] += starts[vertex];
  const next = starts.slice(0, count);
  const corners = new Uint32Array(faces.length);
  faces.forEach((vertex, corner) => {
    corners[next[vertex]++] = corner;
  });
  return { starts, corners };
}

/** Normals at the corners, averaged over faces that meet at less than the crease angle. */
function cornerNormals(points, faces, creaseAngle) {
  const flat = faceNormals(points, faces);
  const { starts, corners } = cornersAround(faces, points.length / 3);
  const least = Math.cos(creaseAngle);
  const lengths = new Float64Array(faces.length / 3);
  for (let face = 0; face < lengths.length; face++) {
    lengths[face] = Math.hypot(flat[3 * face], flat[3 * face + 1], flat[3 * face + 2]) || 1;
  }
  const normals = new Float32Array(3 * faces.length);
  for (let corner = 0; corner < faces.length; corner++) {
    const own = Math.floor(corner / 3);
    const [x, y, z] = flat.subarray(3 * own, 3 * own + 3);
    let [sx, sy, sz] = [0, 0, 0];
    for (let at = starts[faces[corner]]; at < starts[faces[corner] + 1]; at++) {
      const other = Math.floor(corners[at] / 3);
      const [p, q, r] = [flat[3 * other], flat[3 * other + 1], flat[3 * other + 2]];
      if (x * p + y * q + z * r < least * lengths[own] * lengths[other]) continue;
      sx += p;
      sy += q;
      sz += r;
    }
    const length = Math.hypot(sx, sy, sz) || 1;
    normals.set([sx / length, sy / length, sz / length], 3 * corner);
  }
  return normals;
}

// Every corner of a face has the colours of all three corners, so that labels have sharp borders:
// mixed green and orange would look like another label.
const DECLARED = ["attribute vec3 corner;", ...[0, 1, 2].map((k) => `attribute vec3 color${k};`)].join("\n");
const PASSED = ["varying vec3 vCorner;", ...[0, 1, 2].map((k) => `varying vec3 vColor${k};`)].join("\n");
const COPIED = ["vCorner = corner;", ...[0, 1, 2].map((k) => `vColor${k} = color${k};`)].join("\n");
const CHOSEN = `
  vec3 shown = vColor0 * vCorner.x + vColor1 * vCorner.y + vColor2 * vCorner.z;
  if (sharp) {
    shown = vCorner.x >= max(vCorner.y, vCorner.z) ? vColor0 : (vCorner.y >= vCorner.z ? vColor1 : vColor2);
  }
  diffuseColor.rgb = mix(shown / 12.92, pow((shown + 0.055) / 1.055, vec3(2.4)), step(0.04045, shown));
`;

function paintedMaterial(sharp) {
  const material = new MeshLambertMaterial({ side: DoubleSide });
  material.onBeforeCompile = (shader) => {
    shader.uniforms.sharp = sharp;
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>\n${DECLARED}\n${PASSED}`)
      .replace("#include <begin_vertex>", `#include <begin_vertex>\n${COPIED}`);
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>\nuniform bool sharp;\n${PASSED}`)
      .replace("#include <color_fragment>", CHOSEN);
  };
  return material;
}

/** A coloured surface: three corners for each face, relative to the object's centre. */
export class PaintedSurface {
  constructor(object, centre) {
    const { faces, points } = object;
    this.object = object;
    const geometry = new BufferGeometry();
    const positions = new Float32Array(3 * faces.length);
    const corners = new Uint8Array(3 * faces.length);
    for (let corner = 0; corner < faces.length; corner++) {
      for (let k = 0; k < 3; k++) positions[3 * corner + k] = points[3 * faces[corner] + k] - centre[k];
      corners[3 * corner + (corner % 3)] = 1;
    }
    geometry.setAttribute("position", new BufferAttribute(positions, 3));
    geometry.setAttribute("normal", new BufferAttribute(cornerNormals(points, faces, object.creaseAngle), 3));
    geometry.setAttribute("corner", new BufferAttribute(corners, 3));
    for (let k = 0; k < 3; k++) {
      geometry.setAttribute(`color${k}`, new BufferAttribute(new Uint8Array(3 * faces.length), 3, true));
    }
    this.sharp = { value: true };
    this.mesh = new Mesh(geometry, paintedMaterial(this.sharp));
  }

  /** Colours the vertices, from 0 to 255; sharp: each point has the colour of its nearest vertex. */
  paint(colors, sharp) {
    const { faces } = this.object;
    this.sharp.value = sharp;
    for (let k = 0; k < 3; k++) {
      const attribute = this.mesh.geometry.getAttribute(`color${k}`);
      for (let corner = 0; corner < faces.length; corner++) {
        const vertex = faces[corner - (corner % 3) + k];
        attribute.array[3 * corner] = colors[3 * vertex];
        attribute.array[3 * corner + 1] = colors[3 * vertex + 1];
        attribute.array[3 * corner + 2] = colors[3 * vertex + 2];
      }
      attribute.needsUpdate = true;
    }
  }

  dispose() {
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }
}
