// A page for AMD modules of notebooks: keeps the result of the module that is imported next.

import * as base from "@jupyter-widgets/base";

/** @typedef {Record<string, object>} Exports  classes of models and views by their names */

/** @type {{ exports: Exports }} */
export const defined = { exports: {} };

/** @type {Window & {define?: (names: string[], factory: (given: typeof base) => Exports) => void}} */
const page = window;
page.define = (_names, factory) => {
  defined.exports = factory(base);
  delete page.define; // other scripts shall not take the page for one of AMD modules
};
