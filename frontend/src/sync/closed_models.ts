// The release of closed widgets that a host would hold until the page is left.
//
// JupyterLab connects every comm to the kernel's status and never disconnects it; a comm's handlers hold the model, with
// all its traits. ipywidgets leaves the views of layout and style of a view that is removed with their models; widgets
// here share those models, which stay, and the views hold the elements.

import type { Model } from "../types.ts";

/** What ipywidgets' own model has more than a widget's proxy of it; other hosts have less. */
interface HostModel {
  comm?: { on_msg: (handler: () => void) => void; on_close: (handler: () => void) => void };
  get: (name: string) => unknown;
}

/** A view of ipywidgets with those of its layout and its style. */
export interface ViewWithChildren {
  layoutPromise?: Promise<ChildView | undefined>;
  stylePromise?: Promise<ChildView | undefined>;
}

interface ChildView {
  model: { off: (name: string) => void };
  options: { parent?: { model: unknown } };
  remove: () => void;
}

/** The model of a layout or a style; closed, it has no views, but still the promise of the last. */
interface ChildModel {
  views?: Record<string, Promise<ChildView>>;
  state_change?: Promise<ChildView | undefined>;
}

/** Remove the views of layout and style of a view that is being removed. */
export async function removeChildViews({ layoutPromise, stylePromise }: ViewWithChildren) {
  for (const child of await Promise.all([layoutPromise, stylePromise])) if (child) removeChild(child);
}

function removeChild(child: ChildView) {
  child.remove();
  child.model.off("msg:custom"); // which each view hears until the model goes; there are no such messages
  child.options = {}; // without its parent: a model holds the view that was made last
}

async function release(closed: HostModel) {
  closed.comm?.on_msg(nothing);
  closed.comm?.on_close(nothing);
  for (const name of ["layout", "style"]) {
    const { views = {}, state_change } = Object(closed.get(name)) as ChildModel;
    for (const child of await Promise.all([...Object.values(views), state_change]))
      if (child?.options?.parent?.model === closed) removeChild(child);
  }
}

function nothing() {}

/** Release a model when it is closed: the event passes the host's own model. */
export function releaseWhenClosed(model: Model) {
  model.off("destroy", release); // it may have been shown before
  model.on("destroy", release);
}
