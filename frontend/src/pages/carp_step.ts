// A carp in three dimensions, bent by the grids of two drawings and turned by hand.

import { pairPoints, placePair } from "../maths/thompson.ts";
import type { Vector4 } from "../types.ts";
import { planeAlong, voxelRaster } from "../volume/grid.ts";
import type { StepTools } from "./drawing_step.ts";
import type { Examples, Figure } from "./examples.ts";
import { carpVolume } from "./examples.ts";
import type { Opened } from "./opened_file.ts";
import { dataOf, openVolume, subjectOf } from "./opened_file.ts";
import { pageParts, StepPage } from "./step_page.ts";

const SIDE = "-x"; // from the left: its head points left, as in all drawings of Thompson

export class CarpStep {
  page: StepPage | null = null;
  #opened: Promise<Opened> | null = null;
  #number = 0; // of requests to show something

  constructor(
    readonly place: Element,
    readonly tools: StepTools,
    readonly examples: Examples,
  ) {}

  /** Show the carp as bent by a pair of figures, by a share of the whole way. */
  async show(source: Figure, target: Figure, share: number) {
    this.#number += 1;
    const number = this.#number,
      { template, widgets, room, report } = this.tools;
    this.#opened ??= openVolume(carpVolume(this.examples), null, () => {}, new AbortController().signal);
    const opened = await this.#opened,
      data = await dataOf(template, opened, SIDE);
    if (number !== this.#number) return;
    const points = this.#points(opened, source, target);
    Object.assign(data, { controls: [], editor: StepPage.splineTraits(data.editor, points) });
    const { views } = data.view!.volume_info;
    views.home = views[SIDE]; // to which a button turns it back
    const before = this.page,
      root = pageParts(this.place);
    root.classList.add("dnb-th-coming");
    this.place.prepend(root);
    root.querySelector(".dnb-page-picture")?.remove(); // the volume alone
    this.page = new StepPage(data, widgets, "carp", root, room);
    this.page.setShare(share);
    await this.page.open();
    root.classList.remove("dnb-th-coming"); // the one before is seen until then
    before?.close();
    report({ words: "", percent: null });
  }

  #points(opened: Opened, source: Figure, target: Figure) {
    const { grid } = opened.volume,
      {
        shape: [rows, columns],
        spacing: [du, dv],
        origin: [a, b],
      } = voxelRaster(grid, planeAlong(grid, SIDE));
    const frame: Vector4 = [a - du / 2, a + (columns - 0.5) * du, b - dv / 2, b + (rows - 0.5) * dv];
    return pairPoints(placePair(source.nodes, target.nodes, { box: subjectOf(opened, SIDE), frame }));
  }

  setShare(share: number) {
    this.page?.setShare(share);
  }

  hide() {
    this.#number += 1;
    this.page?.close();
    this.page = null;
  }
}
