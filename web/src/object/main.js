import "../shared/page.css";
import "./object.css";
import { byId } from "../shared/dom.js";
import { objectAddress } from "../shared/words.js";
import { loadObject } from "./loading.js";
import { Panel } from "./panel.js";
import { openView } from "./view.js";

const library = JSON.parse(byId("library").textContent);

/** Number in the library of the object that the address names; -1: none. */
function asked() {
  let stem;
  try {
    stem = decodeURIComponent(location.hash.slice(1));
  } catch {
    return -1; // no escaped text at all
  }
  return stem === "" && library.length ? 0 : library.findIndex((one) => one[0] === stem);
}

function showSteps(number) {
  for (const [id, step] of [["previous", -1], ["next", 1]]) {
    const other = library[number + step];
    const button = byId(id);
    button.disabled = number < 0 || !other;
    button.title = other && number >= 0 ? other[1] : "";
    button.onclick = () => {
      location.href = objectAddress(other[0]);
    };
  }
}

function fail(words) {
  byId("name").textContent = words;
  byId("body").hidden = true;
  document.documentElement.dataset.ready = "failed";
}

const view = openView(byId("stage"));
const panel = new Panel(view);
let latest = 0;

async function show() {
  const turn = ++latest;
  delete document.documentElement.dataset.ready;
  const number = asked();
  showSteps(number);
  if (number < 0) {
    fail("The library has no such object.");
    return;
  }
  const [stem, name] = library[number];
  document.title = `${name} – grasp3d`;
  byId("name").textContent = name;
  try {
    const object = await loadObject(stem);
    if (turn !== latest) return;
    panel.show(object);
    document.documentElement.dataset.ready = stem;
  } catch (error) {
    if (turn === latest) fail(error.message);
  }
}

addEventListener("hashchange", show);
show();
