// The base of widgets: a model, a root element, and the disposal of both.

import type { Handlers, Model, ModelHandler } from "../types.ts";
import type { Attributes } from "./dom.ts";
import { pageElement } from "./dom.ts";

export class Widget {
  readonly root: HTMLDivElement;
  readonly closing = new AbortController();
  frame = 0; // the request of the next drawing, or 0
  #handlers: Handlers = [];

  constructor(
    readonly model: Model,
    readonly host: HTMLElement,
    className: string,
    attributes: Attributes = {},
  ) {
    this.root = pageElement("div", className, host, attributes);
    Object.assign(this.root, { deformnb: this }); // for tests and for debugging
  }

  /** Handle an event of the model. */
  on(name: string, handler: ModelHandler) {
    const guarded: ModelHandler = (...given) => this.guard(() => handler(...given));
    this.model.on(name, guarded);
    this.#handlers.push([name, guarded]);
  }

  /** Handle changes of traits. */
  onChange(names: readonly string[], handler: () => void) {
    for (const name of names) this.on(`change:${name}`, handler);
  }

  listen<K extends keyof HTMLElementEventMap>(
    target: EventTarget,
    name: K,
    handler: (event: HTMLElementEventMap[K]) => void,
    options: AddEventListenerOptions = {},
  ) {
    target.addEventListener(name, (event) => this.guard(() => handler(event as HTMLElementEventMap[K])), {
      signal: this.closing.signal,
      ...options,
    });
  }

  /** Run an action; the widget stays usable after an error in it. */
  guard<T>(action: () => T) {
    try {
      return action();
    } catch (error) {
      this.fail(error);
      return undefined;
    }
  }

  fail(error: unknown) {
    console.error(error);
  }

  /** Draw with the next frame. */
  invalidate() {
    if (!this.frame)
      this.frame = requestAnimationFrame(() => {
        this.frame = 0;
        this.guard(() => this.draw());
      });
  }

  draw() {}

  close() {
    this.closing.abort();
    for (const [name, handler] of this.#handlers) this.model.off(name, handler);
    cancelAnimationFrame(this.frame);
    this.root.remove();
  }
}

/** The interface of a widget's module that anywidget requires. */
export function widgetOf<M extends Model>(View: new (model: M, el: HTMLElement) => { close: () => void }) {
  return {
    render({ model, el }: { model: M; el: HTMLElement }) {
      const view = new View(model, el);
      return () => view.close();
    },
  };
}
