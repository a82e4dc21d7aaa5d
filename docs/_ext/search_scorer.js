/* What the search of the site shows first: pages of the guide and names of everyday use, then other
   names, then attributes and options, of which there are thousands. The seven numbers in `Scorer`
   are those of Sphinx, which adds them up before it calls `score`. */
const PLACES = [
  [/^(install|quickstart|tutorial|guide\/.*)$/, 3],
  [/^reference\/commands\/.*$/, 1],
  [/^developing$/, -4],
];
const COMMAND = 30, EVERYDAY = 12, MEMBER = -9;
const EVERYDAY_NAME = /^grasp3d\.\w+$/;
const MEMBERS = /^(Python (attribute|method|property)|.*option), /;

var Scorer = {
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,

  // Of [page, title, anchor, description, score, file, kind].
  score: ([page, title, _anchor, description, score, _file, kind]) => {
    if (kind === "index") return score / 20; // each is an object, or a heading, too
    if (kind === "object") {
      if (MEMBERS.test(description)) return score + MEMBER;
      return EVERYDAY_NAME.test(title) ? score + EVERYDAY : score;
    }
    if (page.startsWith("reference/names/")) return score / 2; // below the object itself
    const words = new URLSearchParams(location.search).get("q") ?? "";
    if (page === `reference/commands/${words.trim().toLowerCase()}`) return COMMAND;
    const place = PLACES.find(([pages]) => pages.test(page));
    return (kind === "title" ? 1.5 * score : score) + (place ? place[1] : 0);
  },
};
