// The application's client: the studio over the whole window, in light or dark.
//
// trame's client brings Vue and the socket. <deformnb-studio> is a Vue component that shows the studio's widgets by a
// widget manager.

import { Widget } from "@lumino/widgets";
import { buttonElement, named } from "../ui/dom.ts";
import type { Component } from "./types.ts";
import { WidgetManager } from "./widget_manager.ts";

const TEXT = "input:not([type=range], [type=checkbox], [readonly]), textarea, [contenteditable]";

export interface Studio {
  $refs: { place: HTMLElement };
  manager: WidgetManager | null;
  shown: Widget | null;
  show: () => Promise<void>;
  close: () => void;
  keyed: (event: KeyboardEvent) => void;
}

let isLeaving = false; // whether the page is being closed or loaded again, which ends requests that wait for Python
window.addEventListener("pagehide", () => {
  isLeaving = true;
});
window.addEventListener("pageshow", () => {
  isLeaving = false;
});

const AppStudio: Component<Studio> = {
  props: {},
  inject: ["trame"],
  template: '<div ref="place" class="dnb-app-studio"></div>',
  methods: {
    /**
     * Shows the studio over the current session: after a broken connection another one, with all loaded again.
     */
    async show() {
      const session = this.trame.client.getConnection().getSession();
      if (this.manager?.session === session) return;
      this.close();
      const manager = new WidgetManager(session),
        { place } = this.$refs;
      this.manager = manager;
      try {
        const view = await manager.open();
        if (this.manager !== manager) return;
        this.shown = view.luminoWidget;
        Widget.attach(view.luminoWidget, place);
      } catch (error) {
        if (this.manager !== manager || isLeaving) return; // the page or its connection was closed meanwhile
        console.error(error);
        place.textContent = `The studio could not be shown: ${(error as Error).message}`;
      }
    },
    close() {
      this.shown?.dispose();
      this.manager?.close();
      this.shown = this.manager = null;
    },
    /** Undo and redo in any focus, except where text is typed or another listener has handled the key. */
    keyed(event: KeyboardEvent) {
      const { target, key } = event,
        isUndo = key.toLowerCase() === "z",
        isRedo = key.toLowerCase() === "y";
      if (event.defaultPrevented || event.altKey || !(event.ctrlKey || event.metaKey) || !(isUndo || isRedo)) return;
      if (target instanceof Element && target.closest(TEXT)) return;
      event.preventDefault();
      const button = document.querySelector(isRedo || event.shiftKey ? ".dnb-head-redo" : ".dnb-head-undo");
      if (button instanceof HTMLElement) button.click();
    },
  },
  async mounted() {
    document.addEventListener("keydown", this.keyed);
    await this.show();
  },
  beforeUnmount() {
    document.removeEventListener("keydown", this.keyed);
    this.close();
  },
};

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
    setTheme(window.matchMedia("(prefers-color-scheme: dark)").matches);
    addThemeButton();
    const viewport = document.querySelector("meta[name=viewport]"); // trame's own does not allow zooming
    viewport?.setAttribute("content", "width=device-width, initial-scale=1");
  },
};
