// The page of the start, before Python can show a studio: what it does, and how far it is.

import { fetchFacts, NO_SESSION, StartScreen } from "./start_screen.ts";

const EVERY = 250; // ms between two requests
const GIVE_UP = 20000; // ms without an answer, after which the program is taken for ended

const ENDED = 'deformnb has ended before it could show the studio: the terminal says why. Start "deformnb app" again.';

async function follow() {
  const screen = new StartScreen();
  window.deformnb_start = screen;
  let last = performance.now();
  for (;;) {
    const facts = await fetchFacts();
    if (facts === "refused") {
      screen.show({ state: "failed", text: NO_SESSION });
      return;
    }
    if (facts?.state === "ready") {
      window.location.reload(); // the application's own page has taken the place of this one
      return;
    }
    if (facts) {
      last = performance.now();
      screen.show(facts);
    } else if (performance.now() - last > GIVE_UP) screen.show({ state: "failed", text: ENDED });
    if (facts?.state === "failed") return;
    await new Promise((resolve) => setTimeout(resolve, EVERY));
  }
}

follow();
