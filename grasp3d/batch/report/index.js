// The table: only a few rows are in the page, those that are sought, in the chosen order.
const data = JSON.parse(document.getElementById("data").textContent);
const ROWS = 50;
const body = document.querySelector("tbody"), heads = [...document.querySelectorAll("thead th")];
const [words, verdict, before, after, position] = ["words", "verdict", "before", "after", "position"]
  .map((id) => document.getElementById(id));
const all = data.mesh.map((_, row) => row);
const texts = all.map((row) =>
  [data.mesh[row], data.verdict[row], data.why[row], data.note[row]].join("\n").toLowerCase());
let rows = all, first = 0, by = 1, down = false;

// What a column is sorted by: texts, or numbers, of which those that are no numbers come last.
function keys(column) {
  if (column === 1) return all; // they are in the order of their names
  if (column === 2) return data.verdict;
  if (column === 3) return data.parts.map((parts) => parts[0] ?? NaN);
  const cells = data.cells[column - 4];
  return cells ? cells.map((text) => parseFloat(text.replaceAll(",", ""))) : data.note;
}

function sorted(found) {
  const key = keys(by), sign = down ? -1 : 1;
  const last = (row) => Number.isNaN(key[row]) || key[row] === "";
  return [...found].sort((a, b) =>
    last(a) - last(b) || sign * ((key[a] > key[b]) - (key[a] < key[b])) || a - b);
}

function element(name, className, ...children) {
  const made = document.createElement(name);
  if (className) made.className = className;
  made.append(...children);
  return made;
}

function link(text, address) {
  const made = element("a", "", text);
  made.href = address;
  return made;
}

function picture(files) {
  if (!files.thumbnail) return "";
  const made = element("img");
  Object.assign(made, { src: files.thumbnail, alt: "", width: 90, height: 68 });
  return made;
}

function fractions(parts) {
  if (parts[0] === null) return [];
  const bar = element("div", "bar");
  parts.forEach((part, k) => {
    bar.append(element("span", "SMU"[k]));
    bar.lastChild.style.width = `${100 * part}%`;
  });
  return [bar, parts.map((part) => `${(100 * part).toFixed(0)} %`).join(" · ")];
}

function line(row) {
  const files = data.files[row], name = data.mesh[row];
  const why = element("span", "quiet", ` ${data.why[row]}`);
  const links = files.labels ? [link("labels", files.labels)] : [];
  const parts = element("td", "text parts", ...fractions(data.parts[row]));
  parts.title = data.causes[row];
  return element("tr", "",
    element("td", "", picture(files)),
    element("td", "text", files.page ? link(name, files.page) : name, element("br"), ...links),
    element("td", "text verdict", element("b", "", data.verdict[row]), why), parts,
    ...data.cells.map((cells) => element("td", "", cells[row])),
    element("td", "text", data.note[row]));
}

function show() {
  body.replaceChildren(...rows.slice(first, first + ROWS).map(line));
  const end = Math.min(first + ROWS, rows.length), of = rows.length.toLocaleString("en");
  position.textContent = rows.length ? `${first + 1}–${end} of ${of}` : "none";
  before.disabled = first === 0;
  after.disabled = end === rows.length;
}

function seek() {
  const sought = words.value.toLowerCase().split(/\s+/);
  rows = sorted(all.filter((row) => (!verdict.value || data.verdict[row] === verdict.value)
    && sought.every((word) => texts[row].includes(word))));
  first = 0;
  show();
}

heads.forEach((head, column) => head.firstChild?.addEventListener("click", () => {
  down = by === column && !down;
  by = column;
  heads.forEach((one) => one.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  seek();
}));
words.addEventListener("input", seek);
verdict.addEventListener("change", seek);
before.addEventListener("click", () => { first -= ROWS; show(); });
after.addEventListener("click", () => { first += ROWS; show(); });
show();
