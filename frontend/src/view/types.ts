// Types that the front ends of a view share.

import type { CameraData } from "../generated.ts";
import type { Matrix3, Model, Sides, Vector2, Vector3 } from "../types.ts";
import type { Shows, ViewName } from "../ui/view_parts.ts";
import type { RayCaster } from "../webgl/raycaster.ts";
import type { PlanarField, SpaceField } from "../webgl/types.ts";
import type { PointerControls } from "./pointer.ts";
import type { SpacePoints } from "./space_points.ts";
import type { ViewCamera } from "./view_camera.ts";
import type { ViewElements, ViewMessages } from "./view_elements.ts";

/** A buffer of a message. */
export type Bytes = DataView<ArrayBuffer> | Uint8Array<ArrayBuffer> | ArrayBuffer;

/** A direction of view and the up vector of the picture. */
export interface ViewDirection {
  direction: Vector3;
  up: Vector3;
}

/** The trait "camera". */
export type CameraTrait = CameraData;

/** The trait "volume_info". That of a view of pictures has neither voxels nor facts about them. */
export interface VolumeInfo {
  id: string;
  shape: Vector3;
  spacing: Vector3;
  /** The place of the first voxel in space. */
  origin: Vector3;
  chunks: number;
  /** Rows of a matrix, from vectors in space to the volume's own frame, and back. */
  to_frame: Matrix3;
  axes: Matrix3;
  /** In the volume's own frame. */
  box: Sides;
  /** The volume's own, where `box` is the result's. */
  own?: Sides;
  outside: number;
  is_labels: boolean;
  grey: Vector2;
  share: number;
  note: string;
  unit: string;
  /** Whether the sides of a patient are known. */
  anatomical?: boolean;
  /** Directions of view by the name of a side, and "home". */
  views: Record<ViewName, ViewDirection>;
}

/** The displacement that is shown. */
export interface Field {
  /** The box of the result, null for the volume's own. */
  box: Sides | null;
  /** Whether cuts of the first steps are shown roughly. */
  coarse?: boolean;
  planar: PlanarField | null;
  space: SpaceField | null;
}

/** The front end of a view, as its camera, its pointer and its points use it. */
export interface VolumeViewLike {
  model: Model;
  messages: ViewMessages;
  elements: ViewElements;
  /** Width and height of the full picture in pixels. */
  readonly pixels: Vector2;
  camera: ViewCamera;
  info: VolumeInfo | null;
  /** The value of the trait "shows" that the camera is for. */
  shown: Shows;
  closed: boolean;
  pointer: PointerControls;
  spacePoints: SpacePoints;
  /** Of a view that has the voxels. */
  readonly values?: Uint8Array | null;
  readonly field?: Field | null;
  readonly caster?: RayCaster | null;
  fail(error: unknown): void;
  touch(held?: boolean): void;
  writeCamera(): void;
  showView(view: ViewName): void;
  /** The finger or the button is lifted. */
  release(): void;
}
