// A button that uploads files, and a drop on the studio around it: one file after the other, in pieces that Python
// requests. Messages to Python: begin, piece, cancel. Messages from Python: next, reading, done.

import type { FileInputToFrontEnd, UploadBegin, UploadCancel, UploadPiece } from "../generated.ts";
import type { Model } from "../types.ts";
import { buttonElement, pageElement, setText } from "../ui/dom.ts";
import { Widget, widgetOf } from "../ui/widget.ts";

const MESSAGE_TIME = 8000; // milliseconds; what Python refuses is shown by the studio

const hasFiles = ({ dataTransfer }: DragEvent) => Boolean(dataTransfer?.types.includes("Files"));

const size = (bytes: number) => (bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`);

/**
 * The endings of names for a chooser of files. Safari and macOS know the last part of an ending alone: without it files
 * of ".nii.gz" cannot be chosen there.
 */
function acceptedNames(endings: string) {
  const all = endings.split(",").map((ending) => ending.trim());
  const last = all
    .filter((ending) => ending.lastIndexOf(".") > 0)
    .map((ending) => ending.slice(ending.lastIndexOf(".")));
  return [...new Set([...all, ...last])].join(",");
}

class FileInputView extends Widget {
  button: HTMLButtonElement;
  chooser: HTMLInputElement;
  state: HTMLDivElement;
  words: HTMLSpanElement;
  bar: HTMLProgressElement;
  stop: HTMLButtonElement;
  veil: HTMLDivElement;

  /** Files that wait for the current one. */
  waiting: File[] = [];

  /** The current upload. */
  current: { id: string; file: File } | null = null;

  depth = 0; // of the elements that a dragged file has entered

  timer = 0;

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-file-input");
    this.button = pageElement("button", "jupyter-widgets jupyter-button widget-button dnb-fi-button", this.root, {
      type: "button",
    });
    this.chooser = pageElement("input", "dnb-fi-chooser", this.root, {
      type: "file",
      hidden: "",
      multiple: "",
      tabindex: "-1",
      "aria-hidden": "true",
    });
    this.state = pageElement("div", "dnb-fi-state", this.root, { hidden: "" });
    this.words = pageElement("span", "dnb-fi-words", this.state, { role: "status" });
    this.bar = pageElement("progress", "dnb-fi-bar", this.state, { max: 1, "aria-label": "share that is done" });
    this.stop = buttonElement("dnb-fi-stop", this.state, "Cancel", () => this.cancel());
    this.veil = pageElement("div", "dnb-fi-veil", this.root, { hidden: "" });
    this.listen(this.button, "click", () => this.chooser.click());
    this.listen(this.chooser, "change", () => {
      this.add([...(this.chooser.files ?? [])]);
      this.chooser.value = ""; // the same file can be chosen again
    });
    if (model.get("drops")) this.#takeDrops();
    this.on("msg:custom", (content: FileInputToFrontEnd) => this.#receive(content));
    this.onChange(["label", "accept", "tip"], () => this.draw());
    this.draw();
  }

  close() {
    this.cancel();
    clearTimeout(this.timer);
    super.close();
  }

  draw() {
    const { model } = this;
    setText(this.button, model.get("label"));
    this.button.title = this.veil.textContent = model.get("tip");
    this.chooser.accept = acceptedNames(model.get("accept"));
  }

  // ---- drops --------------------------------------------------------------------------------------------------------

  /** In the capture phase: JupyterLab would open a file that is dropped, and a browser would leave the page. */
  #takeDrops() {
    const options = { capture: true };
    const isOurs = (event: DragEvent) =>
      hasFiles(event) &&
      event.target instanceof Node &&
      Boolean(this.host.closest(".dnb-studio")?.contains(event.target));
    const enter = (depth: number) => {
      this.depth = depth;
      this.veil.hidden = depth <= 0;
    };
    this.listen(
      window,
      "dragenter",
      (event) => {
        if (isOurs(event)) enter(this.depth + 1);
      },
      options,
    );
    this.listen(
      window,
      "dragleave",
      (event) => {
        if (isOurs(event)) enter(this.depth - 1);
      },
      options,
    );
    this.listen(
      window,
      "dragover",
      (event) => {
        if (!isOurs(event)) return;
        event.preventDefault();
        event.stopPropagation();
        if (event.dataTransfer) event.dataTransfer.dropEffect = "copy";
      },
      options,
    );
    this.listen(
      window,
      "drop",
      (event) => {
        enter(0);
        if (!isOurs(event)) return;
        event.preventDefault();
        event.stopPropagation();
        this.add([...(event.dataTransfer?.files ?? [])]);
      },
      options,
    );
  }

  // ---- uploads ------------------------------------------------------------------------------------------------------

  add(files: File[]) {
    this.waiting.push(...files);
    if (!this.current) this.#begin();
  }

  #begin() {
    const file = this.waiting.shift();
    if (!file) {
      this.current = null;
      return;
    }
    this.current = { id: crypto.getRandomValues(new Uint32Array(4)).join("-"), file };
    this.#show(`Uploading ${file.name} (${size(file.size)})`, 0);
    this.model.send({ type: "begin", id: this.current.id, name: file.name, size: file.size } satisfies UploadBegin);
  }

  cancel() {
    this.waiting = [];
    if (this.current) this.model.send({ type: "cancel", id: this.current.id } satisfies UploadCancel);
  }

  async #receive(content: FileInputToFrontEnd) {
    const { current } = this,
      { id } = content;
    if (!current || current.id !== id) return; // of another client
    const { file } = current;
    if (content.type === "next") {
      const { offset, length } = content;
      this.#show(`Uploading ${file.name} (${size(file.size)})`, offset / file.size);
      try {
        const piece = await file.slice(offset, offset + length).arrayBuffer();
        this.model.send({ type: "piece", id, offset } satisfies UploadPiece, undefined, [piece]);
      } catch {
        // a folder, or a file that has been changed since it was chosen
        this.model.send({ type: "cancel", id } satisfies UploadCancel);
        this.#end(`${file.name} cannot be read by the browser; choose a file that is no folder.`);
      }
    } else if (content.type === "reading") this.#show(`Reading ${file.name}`, content.share);
    else if (content.type === "done") this.#end();
  }

  #end(message: string = "") {
    this.current = null;
    this.state.hidden = !message;
    this.bar.hidden = this.stop.hidden = true;
    setText(this.words, message);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      if (!this.current) this.state.hidden = true;
    }, MESSAGE_TIME);
    this.#begin();
  }

  #show(words: string, share: number) {
    this.state.hidden = this.bar.hidden = this.stop.hidden = false;
    setText(this.words, words);
    this.bar.value = share;
  }
}

export default widgetOf(FileInputView);
