// Keys, scrolling to the inspected vertex, and the notice after the connection was closed.
(() => {
  const ARROWS = { ArrowRight: "Right", ArrowLeft: "Left", ArrowUp: "Up", ArrowDown: "Down" };
  const ACTIONS = {
    s: () => document.getElementById("save").click(),
    g: () => document.getElementById("picture").click(),
    r: () => window.trame.trigger("reset_view"),
    h: () => window.trame.state.set("help", !window.trame.state.get("help")),
  };

  const isTyping = (element) =>
    element.closest("select, textarea, [contenteditable], [role=dialog]") ||
    element.matches("input:not([type=checkbox])");

  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !window.trame?.state.get("keys")) return;
    const key = ARROWS[event.key] ?? (event.key === "=" ? "+" : event.key.toLowerCase());
    if (window.trame.state.get("help") ? key !== "h" : isTyping(event.target)) return;
    if (!window.trame.state.get("keys").some((known) => known.keys.includes(key))) return;
    event.preventDefault();
    if (ACTIONS[key]) ACTIONS[key]();
    else window.trame.trigger("key", [key]);
  });

  // The numbers of a vertex that was just clicked may be outside the visible part of the panel.
  const scrollToInspection = () => {
    const rows = document.getElementById("rows");
    const section = document.getElementById("inspection")?.getBoundingClientRect();
    if (!rows || !section) return;
    const visible = rows.getBoundingClientRect();
    const up = section.top - visible.top;
    const down = Math.min(section.bottom - visible.bottom, up);
    if (up < 0) rows.scrollBy({ top: up, behavior: "smooth" });
    else if (down > 0) rows.scrollBy({ top: down, behavior: "smooth" });
  };

  // While a slider is dragged the contents keep their height, so that nothing moves below the pointer.
  addEventListener("pointerdown", (event) => {
    const content = document.getElementById("content");
    if (content && event.target.matches?.("#rows input[type=range]")) {
      content.style.minHeight = `${content.offsetHeight}px`;
    }
  });
  for (const end of ["pointerup", "pointercancel"]) {
    addEventListener(end, () => {
      document.getElementById("content")?.style.removeProperty("min-height");
    });
  }

  let clicked = null;
  const watchClicks = () => {
    if (!window.trame?.state) {
      setTimeout(watchClicks, 100);
      return;
    }
    window.trame.state.watch(["inspection"], (inspection) => {
      const vertex = inspection?.vertex ?? null;
      if (vertex !== null && vertex !== clicked) setTimeout(scrollToInspection, 50);
      clicked = vertex;
    });
  };
  watchClicks();

  const NativeWebSocket = window.WebSocket;
  window.WebSocket = class extends NativeWebSocket {
    constructor(...args) {
      super(...args);
      this.addEventListener("close", () => {
        document.getElementById("ended").hidden = false;
      });
    }
  };
})();
