// The base of the editors of a picture and in space: frames, messages, colours of the theme.

import { busOf, holdBus, releaseBus } from "../sync/bus.ts";
import type { Sender } from "../sync/edits.ts";
import { senderOf } from "../sync/edits.ts";
import type { Model } from "../types.ts";
import { OWN_KEYS, pageElement } from "../ui/dom.ts";
import { ThemeObserver } from "../ui/theme.ts";
import type { ToolbarHost } from "../ui/toolbar.ts";
import { Frames } from "./frames.ts";
import { Messages } from "./messages.ts";
import type { EditorRoot } from "./stage.ts";

/** The colours of an editor: of the host page, light or dark, Jupyter's or VS Code's, else the browser's. */
export class EditorTheme {
  colours = { stage: "#777", grid: "#777" };

  #observer: ThemeObserver;

  constructor(
    private readonly root: HTMLElement,
    private readonly model: Model,
    private readonly frames: Frames,
  ) {
    this.#observer = new ThemeObserver(root, () => frames.guard(() => this.apply()));
  }

  apply() {
    const root = this.root;
    root.dataset.theme = this.model.get("theme") || "auto";
    root.classList.toggle("dnb-dark", this.#observer.isDark);
    const style = getComputedStyle(root);
    const [stage, grid] = ["--dnb-stage", "--dnb-grid"].map(
      (name) => style.getPropertyValue(name).trim() || "#777",
    ) as [string, string];
    this.colours = { stage, grid };
    this.frames.invalidate();
  }

  close() {
    this.#observer.close();
  }
}

/** The commands of an editor, for its toolbar and the host page. */
export interface EditorCommands {
  /** Run a command on a point; null for the selection. */
  run(command: string, focused: number | null): void;
}

/** The drawing and the messages that both editors share. */
export abstract class EditorDrawing {
  sender: Sender;
  root: HTMLDivElement;
  messages: Messages;
  frames: Frames;
  theme: EditorTheme;

  abstract commands: EditorCommands;

  /** Its box, which takes the focus. */
  abstract stage: EditorRoot;

  constructor(readonly model: Model) {
    const bus = busOf(model);
    this.sender = senderOf(bus, model);
    // A press anywhere in it gives the editor the keys.
    this.root = pageElement("div", "dnb-editor", null, { tabindex: "-1", role: "group", ...OWN_KEYS });
    this.messages = new Messages();
    this.frames = new Frames(
      this.messages,
      () => this.draw(),
      () => Boolean(bus.isShared),
    );
    this.theme = new EditorTheme(this.root, model, this.frames);
  }

  /** Commands for its toolbar. */
  get host(): ToolbarHost {
    return {
      guard: (action) => this.frames.guard(action),
      run: (command, focused) => this.commands.run(command, focused),
    };
  }

  /** Draw everything: each editor has its own. */
  abstract draw(): void;
}

/** Attach the sender of an editor to its model: before any view, until the model is closed. */
export function initialize({ model }: { model: Model }) {
  const bus = busOf(model),
    uid = model.get("uid");
  holdBus(bus);
  const sender = senderOf(bus, model),
    leave = () => sender.flush(); // no pending edit when the page closes
  sender.attach(model); // two consoles of one kernel have two models of one editor
  window.addEventListener("pagehide", leave);
  model.on("destroy", () => {
    window.removeEventListener("pagehide", leave);
    sender.detach(model);
    if (sender.models.length === 0) bus.sender = undefined;
    releaseBus(bus, uid);
  });
}
