// The keys of the page.
(() => {
  const ARROWS = { ArrowRight: "Right", ArrowLeft: "Left", ArrowUp: "Up", ArrowDown: "Down" };
  const ACTIONS = {
    s: () => document.getElementById("save").click(),
    g: () => document.getElementById("picture").click(),
    h: () => document.getElementById("help").togglePopover(),
  };
  const isTyping = (element) => element.matches("select, input:not([type=checkbox])");

  addEventListener("keydown", (event) => {
    const known = window.trame?.state.get("keys")?.flatMap((item) => item.keys) ?? [];
    const key = ARROWS[event.key] ?? (event.key === "=" ? "+" : event.key.toLowerCase());
    if (event.ctrlKey || event.metaKey || event.altKey || !known.includes(key)) return;
    if (document.querySelector(":popover-open") ? key !== "h" : isTyping(event.target)) return;
    event.preventDefault();
    if (ACTIONS[key]) ACTIONS[key]();
    else window.trame.trigger("key", [key]);
  });
})();
