import { byId, element } from "../shared/dom.js";
import { degrees, digits, length } from "../shared/formatting.js";

const DEGREE = Math.PI / 180;

/** Lists the best grasps, as buttons that draw them. */
export function showGrasps(object, draw) {
  const buttons = object.grasps.map((grasp, number) => {
    const description = [
      ...(grasp.pose.length ? [grasp.label] : []),
      `β* ${degrees(grasp.critical_angle / DEGREE)}`,
      `ε ${digits(grasp.epsilon)}`,
      `opening ${length(grasp.opening, object.unit)}`,
      ...(Number.isFinite(grasp.grip_force) ? [`force ${digits(grasp.grip_force)} N`] : []),
      ...(Number.isFinite(grasp.payload) ? [`payload ${digits(grasp.payload)} kg`] : []),
      ...(grasp.pose.length ? [`approach ±${degrees(grasp.approach_margin / DEGREE, 0)}`] : []),
    ].join(" · ");
    const button = element("button", { type: "button" }, element("b", {}, `${number + 1} `), description);
    button.setAttribute("aria-pressed", "false");
    button.addEventListener("click", () => {
      for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
      draw(grasp);
    });
    return button;
  });
  byId("grasps").replaceChildren(...(buttons.length ? buttons : [element("p", { className: "quiet" }, "None stored.")]));
}
