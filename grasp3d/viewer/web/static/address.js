{
  // Address of the web socket, relative to the page, which may be behind a proxy.
  const own = location.pathname.replace(/[^/]*$/, "");
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const socket = `${scheme}//${location.host}${own}ws`;
  history.replaceState(null, "", `${own}?sessionURL=${encodeURIComponent(socket)}`);
}
