import { byId, element } from "../shared/dom.js";
import { degrees, digits, length, percent, plural, smallLength } from "../shared/formatting.js";
import { QUANTITIES, rampCss, vertexColors } from "./colors.js";
import { showGrasps } from "./grasps.js";
import { showVertex } from "./picked_vertex.js";
import { MEANING } from "./reasons.js";
import { M, S, SETTINGS, U, UNSEARCHED, areaFractions, labelsAt, thresholds } from "./thresholds.js";

const DEGREE = Math.PI / 180;
const SHOWN = [S, M, U, UNSEARCHED];
const UNCHANGED = Object.fromEntries(SETTINGS.map((name) => [name, null]));
const UNITS = { friction: 1, resolution: DEGREE, frictionError: 1, normalError: DEGREE };

/** The panel beside the 3-D view. */
export class Panel {
  constructor(view) {
    this.view = view;
    this.chosen = { ...UNCHANGED }; // kept from object to object
    byId("paint").addEventListener("change", () => this.update());
    byId("reset").addEventListener("click", () => this.view.reset());
    byId("as-labelled").addEventListener("click", () => {
      this.chosen = { ...UNCHANGED };
      this.update();
    });
    this.listen("friction", (value) => value > 0);
    this.listen("resolution", (value) => value >= 0 && value < Math.PI);
    this.listen("frictionError", (value) => value >= 0);
    this.listen("normalError", (value) => value >= 0 && value < Math.PI / 2);
    view.onPick((vertex) => this.pick(vertex));
  }

  listen(name, isValid) {
    for (const id of [name, `${name}-number`]) {
      byId(id).addEventListener("input", (event) => {
        const value = Number(event.target.value) * UNITS[name];
        if (event.target.value === "" || !isValid(value)) return;
        this.chosen[name] = value;
        this.update(event.target);
      });
    }
  }

  show(object) {
    this.object = object;
    this.vertex = null;
    byId("body").hidden = false;
    byId("facts").textContent = [
      `size ${length(object.size, object.unit || "(unit not stated)")}`,
      `${plural(object.count, "vertex", "vertices")}, ${plural(object.faces.length / 3, "face")}`,
      object.closed ? "closed" : "open",
      ...(object.gripper ? [`gripper ${object.gripper.name}${object.gripper.table ? " and a table" : ""}`] : []),
    ].join(" · ");
    byId("method").textContent = [
      object.certainty && `Labels are safe: ${object.certainty}.`,
      object.method === "extremes" &&
        "The labels in the table are from sampled extreme normals; here they are from thresholds on the exact critical angle, so a few may differ.",
    ].filter(Boolean).join(" ");
    const labelled = (name) => object[name] / UNITS[name];
    Object.assign(byId("friction"), { min: 0.01, max: Math.max(1.5, object.friction), step: 0.01 });
    Object.assign(byId("resolution"), { min: 0, max: Math.max(90, labelled("resolution")), step: 0.1 });
    Object.assign(byId("frictionError"), { min: 0, max: Math.max(0.5, object.frictionError), step: 0.01 });
    Object.assign(byId("normalError"), { min: 0, max: Math.max(30, labelled("normalError")), step: 0.1 });
    this.showErrors();
    this.showLoad();
    this.showQuantities();
    this.showDetails();
    showGrasps(object, (grasp) => this.drawGrasp(grasp));
    this.view.show(object);
    this.update();
  }

  /** Shows what is uncertain beside the sensor's normals; locations and single fingers are as labelled. */
  showErrors() {
    const { object } = this;
    const { locationError, perFinger, unit } = object;
    byId("errors").open ||= Boolean(object.frictionError || object.normalError || locationError || perFinger);
    byId("located").textContent = [
      locationError ? `Contact locations are within ${smallLength(locationError, unit)}, as labelled.` : "",
      perFinger ? `Each finger, as labelled: ${perFinger}.` : "",
    ].filter(Boolean).join(" ");
    for (const name of ["friction", "frictionError"]) {
      for (const id of [name, `${name}-number`]) byId(id).disabled = Boolean(perFinger);
    }
  }

  /** Shows whether the load is held, if there is one. */
  showLoad() {
    const { load } = this.object;
    byId("load").hidden = !load;
    if (!load) return;
    const held = load.held ? [`held by ${percent(load.held.S, 1)} of the surface`] : [];
    const how = { exact: "at the worst normals", bound: "at the worst normals, a safe bound", sampled: "at the worst of sampled normals" };
    byId("load-text").textContent = load.text;
    byId("load-details").textContent = [...held, `forces ${how[load.how]}, at the friction and resolution of the labels`, load.remedy].filter(Boolean).join("; ");
  }

  /** Lists the quantities that this object has; the chosen one is kept from object to object. */
  showQuantities() {
    const chosen = byId("paint").value;
    const known = Object.entries(QUANTITIES).filter(([, { array }]) => !array || this.object[array]);
    byId("paint").replaceChildren(...known.map(([name, { title }]) => element("option", { value: name }, title)));
    if (known.some(([name]) => name === chosen)) byId("paint").value = chosen;
  }

  update(moved = null) {
    const { object } = this;
    const fixed = object.perFinger ? ["friction", "frictionError"] : [];
    const chosen = (name) => (fixed.includes(name) ? null : this.chosen[name]);
    const settings = Object.fromEntries(SETTINGS.map((name) => [name, chosen(name) ?? object[name]]));
    for (const [name, value] of Object.entries(settings)) {
      for (const id of [name, `${name}-number`]) {
        if (byId(id) !== moved) byId(id).value = String(Number((value / UNITS[name]).toPrecision(5)));
      }
    }
    this.limits = thresholds(object, settings);
    this.labels = labelsAt(object, this.limits);
    const { stable, unstable } = this.limits;
    const [low, high] = [stable, unstable].map((one) => degrees(one / DEGREE));
    const located = object.locationError || object.perFinger;
    const worst = object.fingers === 2 ? "β* + η" : "β* at the worst contact locations";
    const rules = located
      ? [`S where ${worst} is below ${low}`, `U where β* at the best contact locations is at least ${high}`]
      : [`S below ${low}`, `U from ${high} on`];
    byId("thresholds").textContent = [
      stable > 0 ? rules[0] : "no S",
      unstable === Infinity ? "no U" : rules[1],
    ].join(", ") + (located && object.fingers === 2
      ? "; η: how far errors of the contact locations may turn the line between the contacts" : "");
    this.showFractions();
    this.repaint();
    this.showVertex();
  }

  showFractions() {
    const found = areaFractions(this.object, this.labels);
    const shown = SHOWN.filter((label) => label !== UNSEARCHED || found[label] > 0);
    byId("bar").replaceChildren(
      ...shown.map((label) => {
        const part = element("span", { className: MEANING[label][2] });
        part.style.width = `${100 * found[label]}%`;
        return part;
      }),
    );
    byId("fractions").replaceChildren(
      ...shown.map((label) => {
        const [letter, meaning, kind] = MEANING[label];
        const item = element("li", {}, element("i", { className: kind }), element("b", {}, letter), ` ${meaning} `,
          element("output", {}, percent(found[label], 1)));
        item.dataset.label = letter;
        item.dataset.fraction = found[label];
        return item;
      }),
    );
    byId("unsearched").textContent = found[UNSEARCHED] > 0
      ? `Grasps were searched with β* up to ${degrees(this.object.cone / DEGREE)} only: where none of them is stable, M and U cannot be distinguished.`
      : "";
  }

  repaint() {
    const quantity = byId("paint").value;
    const { value, most, unit, unknown = "no grasp found" } = QUANTITIES[quantity];
    this.view.paint(vertexColors(this.object, quantity, this.labels, this.limits), !value);
    const strip = element("div", { className: "strip" });
    strip.style.background = rampCss;
    byId("ramp").replaceChildren(
      ...(value
        ? [strip, element("div", { className: "ends" }, element("span", {}, `0${unit}`),
            element("span", { className: "quiet" }, `grey: ${unknown}`),
            element("span", {}, `${digits(most(this.object, this.limits))}${unit}`))]
        : []),
    );
  }

  pick(vertex) {
    this.vertex = vertex;
    for (const button of document.querySelectorAll("#grasps button")) button.setAttribute("aria-pressed", "false");
    this.view.mark(this.showVertex());
  }

  /** Shows the picked vertex, if any; returns the contact points to mark. */
  showVertex() {
    const label = this.vertex === null ? null : this.labels[this.vertex];
    return showVertex(this.object, this.vertex, label, this.limits);
  }

  drawGrasp(grasp) {
    this.vertex = null;
    this.showVertex();
    this.view.showGrasp(grasp);
  }

  showDetails() {
    const { object } = this;
    const list = (title, items) => items.length
      ? [element("p", {}, title), element("ul", {}, ...items.map((item) => element("li", {}, item)))]
      : [];
    byId("details").replaceChildren(
      element("p", {}, `Labelled at μ ${digits(object.friction, 4)} and α ${degrees(object.resolution / DEGREE)}, ` +
        `${object.fingers} fingers; grasps searched with β* up to ${degrees(object.cone / DEGREE)}.`),
      ...list("Repairs:", object.repairs),
      ...list("Warnings:", object.warnings),
    );
  }
}
