// Files that go between the application and this computer: what Python has written for this page goes to the browser's
// downloads, and a saved session is read and handed to Python. Joined behind app/remote.js and before app/app.js,
// whose Vue application it is a component of; its slot gets `write(kind)` and `open()`.

import { APP_PAGE } from "./remote.js";

const LONGEST_SESSION = 500000; // bytes that Python takes

export const AppFiles = {
  props: { files: Object }, // as DeskFiles.state says it
  inject: ["trame"],
  template: `<slot :write="write" :open="open"></slot>
    <input ref="input" type="file" accept=".json,application/json" hidden aria-label="session file" @change="take">`,
  watch: {
    files(now, before) {
      if (!now.key || now.key === before?.key || now.page !== APP_PAGE) return; // another page has asked for it
      const link = document.createElement("a");
      Object.assign(link, { href: `deformnb/file/${now.key}`, download: now.name });
      link.click();
    },
  },
  methods: {
    write(kind) { this.call("deformnb.write", kind, APP_PAGE); },
    open() { this.$refs.input.click(); },
    async take() {
      const { input } = this.$refs, [file] = input.files, isTooLong = file?.size > LONGEST_SESSION;
      const text = isTooLong ? undefined : await file?.text();
      input.value = ""; // the same file can be chosen again
      if (isTooLong) this.trame.state.set("error", "This file is too long for a session of this page.");
      else if (text !== undefined) this.call("deformnb.take", text);
    },
    // A call that fails because the connection has gone is no news: the page says so by itself.
    call(method, ...given) { this.trame.client.getConnection().getSession().call(method, given).catch(() => {}); },
  },
};
