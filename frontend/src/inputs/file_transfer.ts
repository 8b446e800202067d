// A text for the clipboard or a file for the downloads, from Python; reports the result.

import type { FileTransferToFrontEnd } from "../generated.ts";
import { joinFragments } from "../sync/buffers.ts";
import type { Model } from "../types.ts";

import { OWN_KEYS, pageElement, saveFile } from "../ui/dom.ts";

async function copyText(text: string) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false;
  }
}

function render({ model, el }: { model: Model; el: HTMLElement }) {
  const root = pageElement("div", "dnb-file-transfer", el);
  const line = pageElement("span", "dnb-file-transfer-line", root, { role: "status" });
  const attributes = { readonly: "", hidden: "", "aria-label": "text to copy", spellcheck: "false", ...OWN_KEYS };
  const area = pageElement("textarea", "dnb-file-transfer-text", root, attributes);

  const receive = joinFragments(async (content: FileTransferToFrontEnd, buffers: DataView<ArrayBuffer>[]) => {
    if (content.type === "copy") {
      const isCopied = await copyText(content.text);
      const lines = content.text.trimEnd().split("\n").length;
      line.textContent = isCopied
        ? `Copied ${lines} lines of Python. ${content.note}`.trim()
        : `${content.note} Press Ctrl+C to copy:`.trim();
      area.hidden = false;
      area.value = content.text;
      area.rows = Math.min(12, lines);
      if (!isCopied) {
        area.focus();
        area.select();
      }
    } else if (content.type === "download" && root.isConnected && root === firstShown()) {
      saveFile(new Blob([buffers[0]!]), content.name);
      line.textContent = `Downloaded ${content.name}.`;
    }
  });
  // Two views of one widget must not save a file twice.
  const uid = model.get("uid");
  const firstShown = () =>
    [...document.querySelectorAll(".dnb-file-transfer")].find((other) => other.getAttribute("data-uid") === uid);
  root.dataset.uid = uid;
  model.on("msg:custom", receive);
  return () => {
    model.off("msg:custom", receive);
    root.remove();
  };
}

export default { render };
