// A loader for AMD modules of notebooks: stores the result of the module that is imported next.

import * as base from "@jupyter-widgets/base";

/** Classes of models and views by their names */
export type Exports = Record<string, object>;

export const defined: { exports: Exports } = { exports: {} };

const page: Window & { define?: (names: string[], factory: (given: typeof base) => Exports) => void } = window;
page.define = (_names, factory) => {
  defined.exports = factory(base);
  delete page.define; // other scripts must not take the page for one of AMD modules
};
