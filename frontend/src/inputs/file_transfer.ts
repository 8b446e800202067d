// A text for the clipboard or a file for the downloads, from Python; reports what it has done.

import type { FileTransferToFrontEnd } from "../generated.ts";
import type { Model } from "../types.ts";

import { OWN_KEYS, setAttributes } from "../ui/dom.ts";

async function copied(text: string) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false;
  }
}

function downloaded(name: string, bytes: DataView<ArrayBuffer>) {
  const url = URL.createObjectURL(new Blob([bytes]));
  const link = Object.assign(document.createElement("a"), { href: url, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

function render({ model, el }: { model: Model; el: HTMLElement }) {
  const root = document.createElement("div");
  root.className = "dnb-file-transfer";
  const line = Object.assign(document.createElement("span"), { className: "dnb-file-transfer-line" });
  line.setAttribute("role", "status");
  const area = Object.assign(document.createElement("textarea"), {
    className: "dnb-file-transfer-text",
    readOnly: true,
    hidden: true,
    ariaLabel: "text to copy",
    spellcheck: false,
  });
  setAttributes(area, OWN_KEYS);
  root.append(line, area);
  el.append(root);

  const receive = async (content: FileTransferToFrontEnd, buffers: DataView<ArrayBuffer>[]) => {
    if (content.type === "copy") {
      const isCopied = await copied(content.text);
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
      downloaded(content.name, buffers[0]!);
      line.textContent = `Downloaded ${content.name}.`;
    }
  };
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
