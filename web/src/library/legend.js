import { byId, element } from "../shared/dom.js";

const swatch = (kind) => element("i", { className: kind });

/** Says what every number of the page means. */
export function showLegend(data) {
  const entries = [
    [[swatch("s"), "S"], "surely stable: the grasp holds whatever the true normals within the sensor's resolution"],
    [[swatch("m"), "M"], "the sensor cannot tell"],
    [[swatch("u"), "U"], "no grasp found"],
    [["β*"], "critical friction angle of the best grasp at a place: it holds exactly when the friction angle β = atan μ exceeds β*; the median is taken over the surface by area"],
    [["α for 50, 80, 90 %"], `coarsest sensor resolution below which so much of the surface is S at μ ${data.friction}; none: no sensor is fine enough`],
    [["ε"], "smallest disturbance that the grasp cannot resist (Ferrari & Canny), as a share of the fingers' force; no grasp counts as 0"],
    [["Size"], "diameter of the ball around the surface, in the mesh's own unit"],
    [["Shares"], "of the surface, by area, for the best grasp found at each place"],
  ];
  byId("legend").append(
    ...entries.flatMap(([term, words]) => [element("dt", {}, ...term), element("dd", {}, words)]),
  );
}
