// Keys, what is clicked is brought into view, and what is said when the connection has ended.
(() => {
  const ARROWS = { ArrowRight: "Right", ArrowLeft: "Left", ArrowUp: "Up", ArrowDown: "Down" };
  const HERE = {
    s: () => document.getElementById("save").click(),
    g: () => document.getElementById("picture").click(),
    r: () => window.trame.trigger("look"),
    h: () => window.trame.state.set("help", true),
  };

  const isTyping = (element) =>
    element.closest("select, textarea, [contenteditable], [role=dialog]") ||
    element.matches("input:not([type=checkbox])");

  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !window.trame?.state.get("keys")) return;
    if (isTyping(event.target) || window.trame.state.get("help")) return;
    const key = ARROWS[event.key] ?? (event.key === "=" ? "+" : event.key.toLowerCase());
    if (!window.trame.state.get("keys").some((known) => known.key === key)) return;
    event.preventDefault();
    if (HERE[key]) HERE[key]();
    else window.trame.trigger("press", [key]);
  });

  // What is told of a place that has just been clicked may lie outside the part that is seen.
  const bringIntoView = () => {
    const rows = document.getElementById("rows");
    const place = document.getElementById("place")?.getBoundingClientRect();
    if (!rows || !place) return;
    const seen = rows.getBoundingClientRect();
    const up = place.top - seen.top;
    const down = Math.min(place.bottom - seen.bottom, up);
    if (up < 0) rows.scrollBy({ top: up, behavior: "smooth" });
    else if (down > 0) rows.scrollBy({ top: down, behavior: "smooth" });
  };

  let clicked = null;
  const watchClicks = () => {
    if (!window.trame?.state) {
      setTimeout(watchClicks, 100);
      return;
    }
    window.trame.state.watch(["inspected"], (inspected) => {
      const vertex = inspected?.vertex ?? null;
      if (vertex !== null && vertex !== clicked) setTimeout(bringIntoView, 50);
      clicked = vertex;
    });
  };
  watchClicks();

  const Native = window.WebSocket;
  window.WebSocket = class extends Native {
    constructor(...given) {
      super(...given);
      this.addEventListener("close", () => {
        document.getElementById("ended").hidden = false;
      });
    }
  };
})();
