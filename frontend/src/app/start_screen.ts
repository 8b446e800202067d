// The screen of a page that is loading: name of the volume, a picture of it, and what is being done. The page of the
// start shows it, and then the application's own page, until the studio is drawn.

import { pageElement, setText } from "../ui/dom.ts";

/** Facts of the start, from Python. */
export interface StartFacts {
  state: "loading" | "failed" | "ready";
  name?: string;
  text?: string;
  /** What is said while the application's own page is loading */
  opening?: string;
  /** Share of the work that is done, null where that is not known */
  progress?: number | null;
  /** URL of a picture */
  still?: string;
}

export const NO_SESSION =
  'There is no session for this page. Start "deformnb app" and open the address that it prints: ' +
  "its password changes at each start.";

const SECRET = "deformnb-secret",
  FACTS = "deformnb-start"; // of the tab, from the page of the start to that of the application
const STYLE = `
.dnb-start { position: fixed; inset: 0; z-index: 50; box-sizing: border-box; display: flex; flex-direction: column; align-items: center; justify-content: center;
  gap: 14px; padding: 24px; background: #fff; color: #1f2328; font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif; transition: opacity .2s; }
.dnb-start-still { max-width: min(560px, 100%); max-height: 56vh; min-height: 0; border-radius: 8px; background: #000; image-rendering: auto; }
.dnb-start-still[hidden], .dnb-start-bar[hidden] { display: none; }
.dnb-start-name { font-weight: 600; overflow-wrap: anywhere; text-align: center; }
.dnb-start-text { max-width: 38em; min-height: 1.5em; color: #59636e; text-align: center; overflow-wrap: anywhere; }
.dnb-start-bar { width: min(320px, 80%); height: 5px; accent-color: #0072b2; }
.dnb-start-failed .dnb-start-text { color: #b3261e; }
@media (prefers-color-scheme: dark) {
  .dnb-start { background: #191b20; color: rgba(255, 255, 255, .88); }
  .dnb-start-text { color: rgba(255, 255, 255, .68); }
  .dnb-start-bar { accent-color: #56b4e9; }
  .dnb-start-failed .dnb-start-text { color: #ff8a80; }
}
@media (prefers-reduced-motion: reduce) { .dnb-start { transition: none; } }`;

/** What the page of the start has stored for this tab. */
export function storedFacts(): StartFacts | null {
  try {
    return JSON.parse(window.sessionStorage.getItem(FACTS) ?? "null");
  } catch {
    return null;
  }
}

/**
 * The facts of the start; null where no server answers, "refused" where one answers that does not know this page's
 * password.
 */
export async function fetchFacts(): Promise<StartFacts | "refused" | null> {
  const secret = window.sessionStorage.getItem(SECRET) ?? "";
  try {
    const answer = await fetch("deformnb/start", { headers: { "X-Deformnb-Secret": secret }, cache: "no-store" });
    if (answer.status === 403) return "refused";
    return answer.ok ? await answer.json() : null;
  } catch {
    return null;
  }
}

export class StartScreen {
  readonly root = pageElement("div", "dnb-start", document.body, { role: "status" });
  readonly still = pageElement("img", "dnb-start-still", this.root, { alt: "", hidden: "" });
  readonly name = pageElement("div", "dnb-start-name", this.root, { translate: "no" });
  readonly text = pageElement("div", "dnb-start-text", this.root);
  readonly bar = pageElement("progress", "dnb-start-bar", this.root, { max: "1" });

  constructor() {
    pageElement("style", "", this.root).textContent = STYLE;
  }

  show({ state, name = "", text = "", opening = "", progress = null, still = "" }: StartFacts) {
    setText(this.name, name);
    setText(this.text, text);
    this.bar.hidden = state === "failed";
    if (progress === null) this.bar.removeAttribute("value");
    else this.bar.value = progress;
    this.root.classList.toggle("dnb-start-failed", state === "failed");
    if (still && this.still.src !== still) this.still.src = still;
    this.still.hidden = !still;
    if (name) document.title = `${name} - deformnb`;
    window.sessionStorage.setItem(FACTS, JSON.stringify({ state: "ready", name, text: opening || text, still }));
  }

  close() {
    this.root.remove();
  }
}

declare global {
  interface Window {
    /** The screen of a page that is loading, until the studio is shown. */
    deformnb_start?: StartScreen;
  }
}
