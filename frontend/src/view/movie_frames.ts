// Frames of a movie, drawn by the front end of a live view: as its screenshots, but by a separate ray caster and
// camera, so that a user who turns the view meanwhile turns no frame.
// From Python: movie_frame, movie_end. To Python: movie_piece, movie_failed.

import type { MovieFrame } from "../generated.ts";
import { MOVIE_PIECE } from "../generated.ts";
import { type Clip, isClipped } from "../maths/clipping.ts";
import { floatsOf } from "../sync/buffers.ts";
import type { Model, Values, Vector2 } from "../types.ts";
import { picturesOf, type Shows } from "../ui/view_parts.ts";
import { type Background, RayCaster } from "../webgl/raycaster.ts";
import { fieldOf } from "./follow_editor.ts";
import { FrameLoop } from "./render_loop.ts";
import type { Bytes, Field, VolumeInfo, VolumeViewLike } from "./types.ts";
import { ViewCamera } from "./view_camera.ts";
import type { ViewMessages } from "./view_elements.ts";
import { volumeData } from "./voxels.ts";

/** The live view whose volume and colours are drawn */
export interface MovieSource {
  model: Model;
  info: VolumeInfo | null;
  values: Uint8Array | null;
  messages: ViewMessages;
}

/** Traits of the view as the movie began. */
interface MovieLooks {
  shows: Shows;
  projection: string;
  background: Background;
  show_folds: boolean;
  ambient_occlusion: boolean;
  clip: Clip;
}

/** The movies that Python lets a live view draw, one at a time. */
export class Movies {
  movie: MovieFrames | null = null;

  constructor(private readonly view: MovieSource) {}

  draw(content: MovieFrame, buffers: Bytes[]) {
    const { id } = content;
    if (this.movie?.id !== id) {
      this.close();
      try {
        this.movie = new MovieFrames(this.view, content);
      } catch (error) {
        this.view.messages.send({ type: "movie_failed", id, message: String(error) });
      }
    }
    return this.movie?.draw(content, buffers);
  }

  close() {
    this.movie?.close();
    this.movie = null;
  }
}

class MovieFrames {
  id: string;
  looks: MovieLooks;
  canvas: HTMLCanvasElement;
  caster: RayCaster;
  seen: {
    info: VolumeInfo | null;
    shown: Shows;
    pixels: Vector2;
    pointer: { isBusy: boolean };
    field: Field | null;
    model: { get: (name: string) => unknown };
  };
  camera: ViewCamera;
  loop: FrameLoop;
  isReady: Promise<void>;

  /** @param first the first request for a frame: its size and view state are those of all */
  constructor(
    readonly view: MovieSource,
    { id, size, looks: given }: MovieFrame,
  ) {
    const [width, height] = size,
      looks = given as unknown as MovieLooks;
    this.id = id;
    this.looks = looks;
    this.canvas = Object.assign(document.createElement("canvas"), { width, height });
    this.caster = new RayCaster(this.canvas);
    const { model, info } = view;
    // The properties of a view that a camera needs, with the movie's values.
    const like: MovieFrames["seen"] = {
      info,
      shown: looks.shows,
      pixels: [width, height],
      pointer: { isBusy: false },
      field: null,
      model: { get: (name: string) => (given as Values)[name] },
    };
    this.seen = like;
    this.camera = new ViewCamera(like as unknown as VolumeViewLike);
    this.loop = new FrameLoop(
      this.caster,
      (w, h) => this.#pictures(w, h),
      () => ({ target: 0, settle: 0 }),
      () => {},
      () => {},
    );
    if (looks.shows === "fade") this.loop.screen.mixture = 0.5;
    Object.assign(this.caster, {
      projection: looks.projection,
      background: looks.background,
      showFolds: looks.show_folds,
      occlusion: looks.ambient_occlusion,
      clip: isClipped(looks.clip) ? looks.clip : null,
    });
    this.caster.voxels.setTable(floatsOf(model.get("table")), model.get("unit"));
    this.isReady = this.#load();
  }

  async #load() {
    const { values, info } = this.view;
    if (!values || !info) throw new Error("the volume has not come yet");
    const pause = () =>
      new Promise<void>((resolve) => {
        setTimeout(resolve, 0);
      });
    await this.caster.voxels.setVolume(values, volumeData(info), pause);
  }

  #pictures(width: number, height: number) {
    return picturesOf(this.looks.shows, width).map((picture) => ({
      ...picture,
      camera: this.camera.forAspect((picture.whole ?? picture).width / height),
    }));
  }

  /** Draw a frame and send its PNG in pieces. */
  async draw(content: MovieFrame, buffers: Bytes[]) {
    const { view, id, caster, camera } = this,
      { index } = content;
    try {
      await this.isReady;
      const field = fieldOf(content, buffers, {}) as Field;
      this.seen.field = field;
      camera.read(true);
      caster.fields.setPlanar(field.planar);
      caster.fields.setSpace(field.space);
      if (caster.voxels.volume) caster.voxels.volume.box = camera.box;
      this.loop.drawNow();
      if (caster.gpu.gl.isContextLost()) throw new Error("the graphics card has failed");
      const png = await new Promise((resolve: (blob: Blob | null) => void) => {
        this.canvas.toBlob(resolve, "image/png");
      });
      if (!png) throw new Error("the browser made no picture");
      const bytes = await png.arrayBuffer();
      for (let offset = 0; offset < bytes.byteLength; offset += MOVIE_PIECE) {
        view.messages.send({ type: "movie_piece", id, index, offset, size: bytes.byteLength }, [
          bytes.slice(offset, offset + MOVIE_PIECE),
        ]);
      }
    } catch (error) {
      view.messages.send({
        type: "movie_failed",
        id,
        message: String((error instanceof Error && error.message) || error),
      });
    }
  }

  close() {
    this.loop.close();
    this.caster.dispose();
  }
}
