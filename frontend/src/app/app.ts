// The application's client: the studio over the whole window, in light or dark.
//
// trame's client brings Vue and the socket. Its component <deformnb-studio> stands for a connection, <deformnb-lost> for a
// broken one; the studio's widgets are shown by a widget manager beside Vue's part of the page.

import { buttonElement, named } from "../ui/dom.ts";
import { AppPage } from "./app_page.ts";
import type { Component } from "./types.ts";

const TEXT = "input:not([type=range], [type=checkbox], [readonly]), textarea, [contenteditable]";

/** The page, which outlives Vue's components: trame replaces those when the connection breaks. */
const page = new AppPage();

const AppStudio: Component<object> = {
  props: {},
  inject: ["trame"],
  template: "<span hidden></span>",
  methods: {},
  async mounted() {
    await page.show(this.trame.client.getConnection().getSession());
  },
};

/** In the place of the studio while the connection is broken. */
const AppLost: Component<object> = {
  props: {},
  inject: ["trame"],
  template: "<span hidden></span>",
  methods: {},
  async mounted() {
    await page.lose(this.trame);
  },
};

/** Undo and redo in any focus, except where text is typed or another listener has handled the key. */
document.addEventListener("keydown", (event) => {
  const { target, key } = event,
    isUndo = key.toLowerCase() === "z",
    isRedo = key.toLowerCase() === "y";
  if (event.defaultPrevented || event.altKey || !(event.ctrlKey || event.metaKey) || !(isUndo || isRedo)) return;
  if (target instanceof Element && target.closest(TEXT)) return;
  event.preventDefault();
  const button = document.querySelector(isRedo || event.shiftKey ? ".dnb-head-redo" : ".dnb-head-undo");
  if (button instanceof HTMLElement) button.click();
});

/** Sets light or dark by the attributes of Jupyter's pages. */
function setTheme(isDark: boolean) {
  document.body.dataset.jpThemeLight = String(!isDark);
}

/** The button that changes light and dark. */
function addThemeButton() {
  const label = "Light or dark";
  const turn = () => setTheme(document.body.dataset.jpThemeLight === "true");
  buttonElement("dnb-app-theme", document.body, "\u25d0", turn, named(label));
}

window.deformnb_app = {
  install(app) {
    app.component("deformnb-studio", AppStudio);
    app.component("deformnb-lost", AppLost);
    setTheme(window.matchMedia("(prefers-color-scheme: dark)").matches);
    addThemeButton();
    const viewport = document.querySelector("meta[name=viewport]"); // trame's own does not allow zooming
    viewport?.setAttribute("content", "width=device-width, initial-scale=1");
  },
};
