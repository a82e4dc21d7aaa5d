import { byId, element } from "../shared/dom.js";

const swatch = (kind) => element("i", { className: kind });

/** Shows the definitions of the page's values. */
export function showLegend(data, rows) {
  const within = data.uncertain ? "its uncertainties" : "the sensor resolution";
  const all = data.uncertain ? "all true normals, contact locations and frictions within their uncertainties" : `all true normals within ${within}`;
  const entries = [
    [[swatch("s"), "S"], `surely stable: the grasp is stable for ${all}`],
    [[swatch("m"), "M"], `ambiguous: neither surely stable nor surely unstable within ${within}`],
    [[swatch("u"), "U"], "no grasp found"],
    [["β*"], "critical friction angle of the best grasp found at a contact point: the grasp is force-closed exactly when the friction angle β = atan μ exceeds β*; the median is over the surface, weighted by area"],
    [["α for 80 %"], `coarsest sensor resolution below which this percentage of the surface is S at μ ${data.friction}${data.uncertain ? " and the other uncertainties" : ""}; none: no sensor resolution is fine enough`],
    [["ε"], "smallest disturbance wrench that the grasp cannot resist (Ferrari & Canny), relative to the fingers' force; 0 without a grasp"],
    [["Size"], "diameter of the surface's bounding sphere, in the mesh's unit"],
    [["S / M / U"], "area fractions of the labels of the best grasp found at each point of the surface"],
  ];
  if (data.uncertain) {
    entries.push([["Margin"], "friction angle at the smallest friction, less β* and what the errors of normals and contact locations take: S is where it is above 0"]);
  }
  if (rows.some((row) => row.task)) {
    entries.push([["Payload"], "largest mass that a grasp surely holds with the force at hand, whatever the true normals are within the sensor resolution; held: area fraction of the grasps that surely hold the load. Without a force at hand: the smallest force of each finger that surely holds it"]);
  }
  byId("legend").append(
    ...entries.flatMap(([term, definition]) => [element("dt", {}, ...term), element("dd", {}, definition)]),
  );
}
