// Files between the application and this computer: what Python has written for this window goes to the browser's
// downloads, and a saved session is read and sent to Python. The component's slot gets `write(kind)` and `open()`.

import { APP_PAGE, callPython } from "./session.js";

/** @import { Component } from "./types.d.ts" */

const LONGEST_SESSION = 500000; // bytes that Python takes

/** @typedef {{key?: string, page?: string, name?: string}} WrittenFile the state of ApplicationFiles in Python */

/**
 * @typedef {object} Files
 * @property {WrittenFile} files
 * @property {{input: HTMLInputElement}} $refs
 * @property {(method: string, ...given: unknown[]) => void} call
 */

/** @type {Component<Files>} */
export const AppFiles = {
  props: { files: Object },
  inject: ["trame"],
  template: `<slot :write="write" :open="open"></slot>
    <input ref="input" type="file" accept=".json,application/json" hidden aria-label="session file" @change="take">`,
  watch: {
    /**
     * @param {WrittenFile} now
     * @param {WrittenFile} [before]
     */
    files(now, before) {
      if (!now.key || now.key === before?.key || now.page !== APP_PAGE) return; // of another window
      const link = document.createElement("a");
      Object.assign(link, { href: `deformnb/file/${now.key}`, download: now.name });
      link.click();
    },
  },
  methods: {
    /** @param {string} kind */
    write(kind) { this.call("deformnb.write", kind, APP_PAGE); },
    open() { this.$refs.input.click(); },
    async take() {
      const { input } = this.$refs, file = input.files?.[0], isTooLong = (file?.size ?? 0) > LONGEST_SESSION;
      const text = isTooLong ? undefined : await file?.text();
      input.value = ""; // the same file can be chosen again
      if (isTooLong) this.trame.state.set("error", "This file is too long for a session of this page.");
      else if (text !== undefined) this.call("deformnb.take", text);
    },
    /**
     * @param {string} method
     * @param {unknown[]} given
     */
    call(method, ...given) { callPython(this.trame.client.getConnection().getSession(), method, given); },
  },
};
