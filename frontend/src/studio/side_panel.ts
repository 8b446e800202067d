// The panel next to the panes: the splitter that sets its width, and its state stored in this browser: the width, the
// tab, and which sections are open.
//
// All clients of a studio share the state of tabs and sections. So the stored state is applied only to those still as
// the studio was made (class dnb-section-open): a second client changes nothing for the first.
// It is stored in a cookie, for an application has another port at each start, and local storage belongs to a port.
// Frames with an origin that nothing shares have no cookies: their panels begin as the studio was made.

import { buttonElement, iconElement, OWN_KEYS, pageElement, setAttributes } from "../ui/dom.ts";

const COOKIE = "deformnb-side-panel";
const KEPT = "path=/; max-age=31536000; SameSite=Strict"; // a year
const FIRST = 304,
  LEAST = 240; // CSS pixels
const ROOM_FOR_PANEL = 880; // CSS pixels of a studio, below which the panel is folded away at first
const FOLD = "M2.5 3h11v10h-11zM9.5 3v10M5 6l2 2-2 2";
const MOST = 0.6; // of the studio
const STEP = 16,
  LARGE_STEP = 64; // CSS pixels of an arrow key without and with Shift

export type Remembered = { width?: number; folded?: boolean; tab?: string; open?: Record<string, boolean> };

function cookies() {
  try {
    return document.cookie;
  } catch {
    return null;
  }
}

function storedLayout(): Remembered {
  const found = (cookies() ?? "")
    .split("; ")
    .find((part) => part.startsWith(`${COOKIE}=`))
    ?.slice(COOKIE.length + 1);
  try {
    return JSON.parse(decodeURIComponent(found ?? "%7B%7D")) ?? {};
  } catch {
    return {};
  }
}

function remember(changes: Remembered) {
  if (cookies() === null) return;
  const before = storedLayout(),
    value = JSON.stringify({ ...before, ...changes });
  // biome-ignore lint/suspicious/noDocumentCookie: not every browser has the Cookie Store API
  if (value !== JSON.stringify(before)) document.cookie = `${COOKIE}=${encodeURIComponent(value)}; ${KEPT}`;
}

const headingOf = (section: Element) => section.querySelector<HTMLElement>(".dnb-section-head");
const isOpen = (section: Element) => headingOf(section)?.getAttribute("aria-expanded") === "true";

export class SidePanel {
  splitter: HTMLDivElement;

  /** The button that folds the panel away, and shows it again. */
  folder: HTMLButtonElement;

  closing = new AbortController();
  changes: MutationObserver;
  sizes: ResizeObserver;

  /** Whether each section was open when it was looked at last. */
  sections: Map<Element, boolean> = new Map();

  /** Height of each section. */
  heights: Map<Element, number> = new Map();

  isTabSet = false;

  /** The section that was opened last: its contents are made by the kernel. */
  opened: Element | null = null;

  isUsed = false; // by the user of this client, and not only by Python or another client

  frame = 0;

  /**
   * @param body of the studio
   * @param panel in it
   */
  constructor(
    readonly body: HTMLElement,
    readonly panel: HTMLElement,
  ) {
    this.splitter = pageElement("div", "dnb-splitter", body, {
      role: "separator",
      tabindex: 0,
      "aria-orientation": "vertical",
      "aria-label": "Width of the panel",
      title: "Drag, or press an arrow, to change the width; double-click for the first one",
      ...OWN_KEYS,
    });
    this.folder = buttonElement("dnb-panel-fold", panel, iconElement(FOLD), () => this.fold(!this.isFolded));
    const { signal } = this.closing,
      options = { signal, capture: true };
    // A tab of a panel that is folded away shows it.
    panel.addEventListener(
      "click",
      ({ target }) => {
        if (this.isFolded && target instanceof Element && target.closest(".dnb-tab")) this.fold(false);
      },
      { signal },
    );
    for (const name of ["pointerdown", "keydown"]) {
      panel.addEventListener(
        name,
        ({ isTrusted }) => {
          this.isUsed ||= isTrusted;
          this.opened = null;
        },
        options,
      );
    }
    this.splitter.addEventListener("pointerdown", (event) => this.#grab(event), { signal });
    this.splitter.addEventListener("keydown", (event) => this.#key(event), { signal });
    this.splitter.addEventListener("dblclick", () => this.setWidth(FIRST), { signal });
    this.changes = new MutationObserver(() => {
      cancelAnimationFrame(this.frame);
      this.frame = requestAnimationFrame(() => this.#follow());
    });
    const attributeFilter = ["aria-expanded", "aria-selected"];
    this.changes.observe(panel, { subtree: true, childList: true, attributes: true, attributeFilter });
    this.sizes = new ResizeObserver((entries) => {
      for (const { target } of entries) this.#revealSection(target);
    });
    const { width, folded } = storedLayout();
    this.#show(typeof width === "number" ? width : FIRST);
    this.#showFolded(folded ?? (this.isSideColumn && this.body.clientWidth < ROOM_FOR_PANEL));
    this.#follow();
  }

  close() {
    this.changes.disconnect();
    this.sizes.disconnect();
    cancelAnimationFrame(this.frame);
    this.closing.abort();
    this.splitter.remove();
    this.folder.remove();
    this.body.classList.remove("dnb-panel-folded");
  }

  // ---- the width ----------------------------------------------------------------------------------------------------

  get #most() {
    return Math.max(LEAST, Math.round(MOST * this.body.clientWidth));
  }

  /** Whether the panel is next to the panes, and not below them. */
  get isSideColumn() {
    return getComputedStyle(this.body).display === "grid";
  }

  get isFolded() {
    return this.body.classList.contains("dnb-panel-folded");
  }

  /** Fold the panel away but for its tabs, or show it again. */
  fold(isFolded: boolean) {
    this.#showFolded(isFolded);
    remember({ folded: isFolded });
  }

  #showFolded(isFolded: boolean) {
    this.body.classList.toggle("dnb-panel-folded", isFolded);
    const words = isFolded ? "Show the panel" : "Fold the panel away";
    setAttributes(this.folder, { "aria-expanded": !isFolded, title: words, "aria-label": words });
  }

  /** @param width CSS pixels */
  setWidth(width: number) {
    remember({ width: this.#show(width) });
  }

  #show(width: number) {
    const shown = Math.round(Math.max(LEAST, Math.min(this.#most, width)));
    this.body.style.setProperty("--dnb-side", `${shown}px`);
    setAttributes(this.splitter, { "aria-valuenow": shown, "aria-valuemin": LEAST, "aria-valuemax": this.#most });
    return shown;
  }

  #grab(event: PointerEvent) {
    if (event.button !== 0) return;
    event.preventDefault();
    const { splitter } = this,
      from = event.clientX,
      width = this.panel.offsetWidth,
      ended = new AbortController();
    let now = width;
    splitter.setPointerCapture(event.pointerId);
    splitter.classList.add("dnb-splitter-held");
    splitter.focus();
    splitter.addEventListener(
      "pointermove",
      ({ clientX }) => {
        now = this.#show(width + from - clientX);
      },
      { signal: ended.signal },
    );
    for (const name of ["pointerup", "pointercancel"] as const) {
      splitter.addEventListener(
        name,
        () => {
          ended.abort();
          splitter.classList.remove("dnb-splitter-held");
          if (now !== width) this.setWidth(now);
        },
        { signal: ended.signal },
      );
    }
  }

  #key(event: KeyboardEvent) {
    const step = event.shiftKey ? LARGE_STEP : STEP,
      { offsetWidth } = this.panel;
    const widths: Record<string, number> = {
      ArrowLeft: offsetWidth + step,
      ArrowRight: offsetWidth - step,
      Home: LEAST,
      End: this.#most,
    };
    const width = widths[event.key];
    if (width === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    this.setWidth(width);
  }

  // ---- tab and sections ---------------------------------------------------------------------------------------------

  /** Apply the stored state to loaded sections, store the user's changes, and show the opened section. */
  #follow() {
    const { open = {}, tab } = storedLayout();
    this.#followTab(tab);
    const now = { ...open };
    for (const section of this.panel.querySelectorAll(".dnb-section")) {
      const heading = headingOf(section),
        title = heading?.textContent?.trim();
      if (!heading || !title) continue;
      const before = this.sections.get(section),
        wanted = open[title],
        isFirst = section.classList.contains("dnb-section-open");
      if (before === undefined && wanted !== undefined && wanted !== isOpen(section) && isFirst === isOpen(section))
        heading.click();
      const is = isOpen(section);
      if (before === false && is) {
        this.opened = section;
        this.#scrollTo(section);
      }
      if (before === undefined) this.sizes.observe(section);
      this.sections.set(section, is);
      now[title] = is;
    }
    if (this.isUsed) remember({ open: now });
  }

  #followTab(wanted: string | undefined) {
    const tabs = [...this.panel.querySelectorAll<HTMLElement>(".dnb-tab")],
      current = tabs.find((tab) => tab.getAttribute("aria-selected") === "true");
    if (!current) return;
    const there = tabs.find((tab) => tab.textContent?.trim() === wanted);
    if (!this.isTabSet && there && current === tabs[0] && there !== current) there.click();
    this.isTabSet = true;
    if (this.isUsed) remember({ tab: current.textContent?.trim() });
  }

  /** A section that grows by its contents, or by a choice in one of its menus, is scrolled into view. */
  #revealSection(section: Element) {
    const { height } = section.getBoundingClientRect(),
      before = this.heights.get(section) ?? height;
    this.heights.set(section, height);
    const { activeElement } = document;
    const isChosen = activeElement?.matches("select") && section.contains(activeElement);
    if (height > before && (section === this.opened || isChosen)) this.#scrollTo(section);
  }

  /** By the panel's own scroll bar: scrollIntoView would move the page. */
  #scrollTo(section: Element) {
    const group = section.closest(".dnb-group");
    if (!group) return;
    const outer = group.getBoundingClientRect(),
      { top, bottom } = section.getBoundingClientRect();
    if (bottom > outer.bottom) group.scrollTop += Math.min(bottom - outer.bottom, top - outer.top);
  }
}
