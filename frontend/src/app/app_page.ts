// The studio over the whole window. It outlives its connection: pictures, points and camera stay while no Python answers,
// and another studio takes the place of this one, once it is drawn, when one does.

import { Widget } from "@lumino/widgets";
import { pageElement, viewOf } from "../ui/dom.ts";
import { giveBack, type Held, hold } from "./outage.ts";
import { fetchFacts } from "./start_screen.ts";
import type { Session, Trame } from "./types.ts";
import { WidgetManager } from "./widget_manager.ts";

const DRAWN_WITHIN = 20000; // ms, after which a studio is shown as it is
const ASK_EVERY = 1000; // ms between two requests whether Python is back

const REFUSED =
  "Another session runs at this address now. Open the address that it prints; the last edit here is under History.";
const NOT_WHOLE = "What was changed while deformnb was away lies on another picture, and could not be taken over.";
const BACK = "deformnb is back, and the session goes on.";

/** A studio in the page. */
interface Shown {
  manager: WidgetManager;
  place: HTMLElement;
  widget: Widget;
}

interface EditorParts {
  parts?: { picture: { painter: { source: unknown } } };
}

let isLeaving = false; // whether the page is being closed or loaded again, which ends requests that wait for Python
window.addEventListener("pagehide", () => {
  isLeaving = true;
});
window.addEventListener("pageshow", () => {
  isLeaving = false;
});

const nextFrame = () => new Promise(requestAnimationFrame);

/** Resolves once picture and volume of a studio are drawn. */
async function drawn(place: HTMLElement) {
  const end = performance.now() + DRAWN_WITHIN;
  const isThere = () => {
    const editor = viewOf<EditorParts>(place.querySelector(".dnb-editor")),
      view = viewOf<{ caster?: { isReady: boolean } | null }>(place.querySelector(".dnb-view"));
    const isPainted = Boolean(editor) && (!editor?.parts?.picture || Boolean(editor.parts.picture.painter.source));
    return isPainted && (!view || !("caster" in view) || Boolean(view.caster?.isReady));
  };
  while (!isThere() && performance.now() < end && !document.hidden) await nextFrame();
  await nextFrame();
}

export class AppPage {
  readonly root = pageElement("div", "dnb-app-studio", document.body);

  /** The manager of the connection */
  manager: WidgetManager | null = null;
  #shown: Shown | null = null;
  #outage: AbortController | null = null;
  #notice = pageElement("div", "dnb-app-notice", document.body, { role: "status", hidden: "" });

  /** Show the studio over a session: after a broken connection another one, in place of what is shown. */
  async show(session: Session) {
    this.#outage?.abort();
    if (this.manager?.session === session) return;
    const manager = new WidgetManager(session);
    this.manager = manager;
    const place = pageElement("main", "dnb-app-place", null);
    try {
      const held = this.#shown && (await hold(this.#shown.manager));
      const view = await manager.open();
      if (this.manager !== manager) return;
      this.root.prepend(place); // below the one that is shown
      Widget.attach(view.luminoWidget, place);
      const isWhole = !held || (await giveBack(manager, held));
      await drawn(place);
      if (this.manager !== manager) {
        this.#remove({ manager, place, widget: view.luminoWidget });
        return;
      }
      this.#replace({ manager, place, widget: view.luminoWidget });
      if (held) this.#notify(isWhole ? BACK : NOT_WHOLE);
    } catch (error) {
      place.remove();
      if (this.manager !== manager || isLeaving) return; // the page or its connection was closed meanwhile
      console.error(error);
      window.deformnb_start?.close();
      this.#notify(`The studio could not be shown: ${(error as Error).message}`, true);
    }
  }

  #replace(shown: Shown) {
    const before = this.#shown;
    this.#shown = shown;
    if (before) this.#remove(before);
    window.deformnb_start?.close();
  }

  #remove({ manager, place, widget }: Shown) {
    widget.dispose();
    manager.close();
    place.remove();
  }

  #notify(text: string, isLasting = false) {
    this.#notice.textContent = text;
    this.#notice.hidden = !text;
    if (text && !isLasting)
      setTimeout(() => {
        if (this.#notice.textContent === text) this.#notice.hidden = true;
      }, 8000);
  }

  /** The connection is broken: keep what is shown, and connect again when Python answers. */
  async lose(trame: Trame) {
    this.#outage?.abort();
    const outage = new AbortController();
    this.#outage = outage;
    this.manager = null;
    await this.#shown?.manager.lose();
    while (!outage.signal.aborted && !isLeaving) {
      await new Promise((resolve) => setTimeout(resolve, ASK_EVERY));
      const facts = await fetchFacts();
      if (outage.signal.aborted) return;
      if (facts === "refused") this.#notify(REFUSED, true);
      else if (facts?.state === "failed") this.#notify(facts.text ?? "", true);
      else if (facts?.state === "loading") this.#notify("deformnb is loading \u2026", true);
      else if (facts) {
        this.#notify("");
        await trame.connect().catch((error) => console.warn(error));
      }
    }
  }

  /** The page or its component is removed. */
  close() {
    this.#outage?.abort();
    if (this.#shown) this.#remove(this.#shown);
    this.manager = this.#shown = null;
  }
}

export type { Held };
