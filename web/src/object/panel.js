import { byId, element } from "../shared/dom.js";
import { degrees, digits, length, percent, plural } from "../shared/words.js";
import { PAINTS, rampCss, vertexColors } from "./colors.js";
import { showGrasps } from "./grasps.js";
import { showPlace } from "./place.js";
import { MEANING } from "./reasons.js";
import { M, S, U, UNSEARCHED, labelsAt, shares, thresholds } from "./rule.js";

const DEGREE = Math.PI / 180;
const SHOWN = [S, M, U, UNSEARCHED];

/** Everything beside the picture. */
export class Panel {
  constructor(view) {
    this.view = view;
    this.asked = { friction: null, resolution: null }; // what the reader moved stays from object to object
    const options = Object.entries(PAINTS).map(([name, { words }]) => element("option", { value: name }, words));
    byId("paint").append(...options);
    byId("paint").addEventListener("change", () => this.update());
    byId("reset").addEventListener("click", () => this.view.reset());
    byId("as-labelled").addEventListener("click", () => {
      this.asked = { friction: null, resolution: null };
      this.update();
    });
    this.listen("friction", 1, (value) => value > 0);
    this.listen("resolution", DEGREE, (value) => value >= 0 && value < Math.PI);
    view.onPick((vertex) => this.pick(vertex));
  }

  listen(name, unit, possible) {
    for (const id of [name, `${name}-number`]) {
      byId(id).addEventListener("input", (event) => {
        const value = Number(event.target.value) * unit;
        if (event.target.value === "" || !possible(value)) return;
        this.asked[name] = value;
        this.update(event.target);
      });
    }
  }

  show(object) {
    this.object = object;
    this.vertex = null;
    byId("body").hidden = false;
    byId("facts").textContent = [
      `${length(object.size, object.unit)} large`,
      `${plural(object.count, "vertex", "vertices")}, ${plural(object.faces.length / 3, "face")}`,
      object.closed ? "closed" : "open",
    ].join(" · ");
    byId("method").textContent =
      object.method === "extremes"
        ? "The labels of the table come from sampled extreme normals; here they are by threshold on the exact critical angle, so a few may differ."
        : "";
    const most = { friction: Math.max(1.5, object.friction), resolution: Math.max(90, object.resolution / DEGREE) };
    Object.assign(byId("friction"), { min: 0.01, max: most.friction, step: 0.01 });
    Object.assign(byId("resolution"), { min: 0, max: most.resolution, step: 0.1 });
    this.showMade();
    showGrasps(object, (grasp) => this.drawGrasp(grasp));
    this.view.show(object);
    this.update();
  }

  update(moved = null) {
    const { object } = this;
    const friction = this.asked.friction ?? object.friction;
    const resolution = this.asked.resolution ?? object.resolution;
    const shown = { friction, resolution: resolution / DEGREE };
    for (const [name, value] of Object.entries(shown)) {
      for (const id of [name, `${name}-number`]) {
        if (byId(id) !== moved) byId(id).value = String(Number(value.toPrecision(5)));
      }
    }
    this.limits = thresholds(object, friction, resolution);
    this.labels = labelsAt(object, this.limits);
    const { stable, unstable } = this.limits;
    byId("rule").textContent = [
      stable > 0 ? `S below ${degrees(stable / DEGREE)}` : "no S",
      unstable === Infinity ? "no U" : `U from ${degrees(unstable / DEGREE)} on`,
    ].join(", ");
    this.showShares();
    this.repaint();
    this.showPlace();
  }

  showShares() {
    const found = shares(this.object, this.labels);
    const shown = SHOWN.filter((label) => label !== UNSEARCHED || found[label] > 0);
    byId("bar").replaceChildren(
      ...shown.map((label) => {
        const part = element("span", { className: MEANING[label][2] });
        part.style.width = `${100 * found[label]}%`;
        return part;
      }),
    );
    byId("shares").replaceChildren(
      ...shown.map((label) => {
        const [letter, words, kind] = MEANING[label];
        const item = element("li", {}, element("i", { className: kind }), element("b", {}, letter), ` ${words} `,
          element("output", {}, percent(found[label], 1)));
        item.dataset.label = letter;
        item.dataset.share = found[label];
        return item;
      }),
    );
    byId("unsearched").textContent = found[UNSEARCHED] > 0
      ? `Grasps were searched with β* up to ${degrees(this.object.cone / DEGREE)} only: where none of them will do, M and U cannot be told apart.`
      : "";
  }

  repaint() {
    const paint = byId("paint").value;
    const { value, most, unit } = PAINTS[paint];
    this.view.paint(vertexColors(this.object, paint, this.labels, this.limits), !value);
    const strip = element("div", { className: "strip" });
    strip.style.background = rampCss;
    byId("ramp").replaceChildren(
      ...(value
        ? [strip, element("div", { className: "ends" }, element("span", {}, `0${unit}`),
            element("span", { className: "quiet" }, "grey: no grasp found"),
            element("span", {}, `${digits(most(this.object, this.limits))}${unit}`))]
        : []),
    );
  }

  pick(vertex) {
    this.vertex = vertex;
    for (const button of document.querySelectorAll("#grasps button")) button.setAttribute("aria-pressed", "false");
    this.view.mark(this.showPlace());
  }

  /** Shows the picked place, if any; returns the contacts to mark. */
  showPlace() {
    const label = this.vertex === null ? null : this.labels[this.vertex];
    return showPlace(this.object, this.vertex, label, this.limits);
  }

  drawGrasp(grasp) {
    this.vertex = null;
    this.showPlace();
    this.view.mark(grasp.points);
  }

  showMade() {
    const { object } = this;
    const list = (words, items) => items.length
      ? [element("p", {}, words), element("ul", {}, ...items.map((item) => element("li", {}, item)))]
      : [];
    byId("made").replaceChildren(
      element("p", {}, `Labelled at μ ${digits(object.friction, 4)} and α ${degrees(object.resolution / DEGREE)}, ` +
        `${object.fingers} fingers; grasps searched with β* up to ${degrees(object.cone / DEGREE)}.`),
      ...list("Mended:", object.repairs),
      ...list("Warnings:", object.warnings),
    );
  }
}
