import "../shared/page.css";
import "./object.css";
import { byId } from "../shared/dom.js";
import { objectAddress } from "../shared/formatting.js";
import { loadObject } from "./loading.js";
import { Panel } from "./panel.js";
import { openView } from "./view.js";

const library = JSON.parse(byId("library").textContent);

/** Number of the object in the address; -1: there is no such object. */
function requestedNumber() {
  let stem;
  try {
    stem = decodeURIComponent(location.hash.slice(1));
  } catch {
    return -1; // not a valid escape sequence
  }
  return stem === "" && library.length ? 0 : library.findIndex((one) => one[0] === stem);
}

function updateButtons(number) {
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

function fail(message) {
  byId("name").textContent = message;
  byId("body").hidden = true;
  document.documentElement.dataset.ready = "failed";
}

const view = openView(byId("stage"));
const panel = new Panel(view);
let latest = 0;

async function show() {
  const turn = ++latest;
  delete document.documentElement.dataset.ready;
  const number = requestedNumber();
  updateButtons(number);
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
