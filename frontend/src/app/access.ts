// Runs before anything else of the application: reads the password from the address once and removes it from there.
//
// trame's client takes it from the address and removes it there, so a page that is loaded again would have none. It is
// stored for this tab. Nothing in the address may name another server to talk to.

import { NO_SESSION, StartScreen, storedFacts } from "./start_screen.ts";

(() => {
  const KEY = "deformnb-secret",
    address = new URL(window.location.href),
    { searchParams } = address;
  for (const name of ["sessionURL", "sessionManagerURL", "wsProxy", "wsChannel", "iframe"]) searchParams.delete(name);
  const given = searchParams.get("secret"),
    kept = window.sessionStorage.getItem(KEY);
  if (given) window.sessionStorage.setItem(KEY, given);
  else if (kept) searchParams.set("secret", kept);
  searchParams.set("sessionURL", `ws://${window.location.host}/ws`); // else the client needs a launcher
  window.history.replaceState({}, document.title, `${address.pathname}${address.search}${address.hash}`);

  // A client that is refused writes a bare line into the page.
  document.addEventListener("DOMContentLoaded", () => {
    const app = document.getElementById("app");
    if (!app) return;
    if (!window.deformnb_start) {
      window.deformnb_start = new StartScreen(); // the page of the start has one already
      window.deformnb_start.show({ state: "ready", text: "Opening the studio \u2026", ...storedFacts() });
    }
    new MutationObserver(() => {
      if (app.childElementCount || !app.textContent) return;
      const note = document.createElement("p");
      note.textContent = NO_SESSION;
      note.style.cssText = "max-width: 34em; margin: 20vh auto; padding: 0 1em; font: 17px/1.5 system-ui, sans-serif";
      app.replaceChildren(note);
      window.deformnb_start?.close();
    }).observe(app, { childList: true });
  });
})();
