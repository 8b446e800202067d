// One WebGL2 context: its programs, its textures, and the pictures that are drawn into.

import { VERTEX } from "./ray_shader.ts";

/** The location of a program's uniform; null where the program has none of that name. */
export type Uniforms = (name: string) => WebGLUniformLocation | null;
export type Program = { program: WebGLProgram; at: Uniforms };
/** A picture to draw into. */
export type Target = {
  width: number;
  height: number;
  texture: WebGLTexture;
  buffer: WebGLFramebuffer;
};

export const UNITS = {
  volume: 0,
  cells: 1,
  ambience: 2,
  table: 3,
  maps: 4,
  weights: 5,
  space: 6,
  picture: 7,
  distances: 8,
  depths: 9,
  second: 10,
  ownCells: 11,
};
export type Unit = keyof typeof UNITS;

function compileShader(gl: WebGL2RenderingContext, type: GLenum, source: string) {
  const shader = gl.createShader(type) as WebGLShader; // null only where the context is lost
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
    throw new Error(`shader: ${gl.getShaderInfoLog(shader)}`);
  }
  return shader;
}

function linkProgram(gl: WebGL2RenderingContext, fragment: string): Program {
  const program = gl.createProgram();
  gl.attachShader(program, compileShader(gl, gl.VERTEX_SHADER, VERTEX));
  gl.attachShader(program, compileShader(gl, gl.FRAGMENT_SHADER, fragment));
  gl.bindAttribLocation(program, 0, "corner");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`program: ${gl.getProgramInfoLog(program)}`);
  }
  const locations = new Map<string, WebGLUniformLocation | null>();
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) || 0;
  for (let i = 0; i < count; i++) {
    const { name } = gl.getActiveUniform(program, i) as WebGLActiveInfo;
    locations.set(name, gl.getUniformLocation(program, name));
  }
  return { program, at: (name) => locations.get(name) ?? null };
}

export class Gpu {
  gl: WebGL2RenderingContext;
  /** Whether pictures hold floats, and whether textures of floats are interpolated */
  floats: boolean;
  smoothFloats: boolean;
  name: string;
  isSoftware: boolean;
  /** The longest side of a texture in space */
  largest: number;
  programs: Record<string, Program> = {};
  targets: Record<string, Target> = {};
  #textures: { [unit in Unit]?: WebGLTexture } = {};

  /**
   * Throws an Error with a readable reason if there is no WebGL2.
   * @param canvas a canvas without a context
   */
  constructor(readonly canvas: HTMLCanvasElement) {
    const gl = canvas.getContext("webgl2", {
      antialias: false,
      alpha: false,
      depth: false,
      stencil: false,
      powerPreference: "high-performance",
    });
    if (!gl) throw new Error("this browser offers no WebGL2 here");
    this.gl = gl;
    this.floats = Boolean(gl.getExtension("EXT_color_buffer_float") || gl.getExtension("EXT_color_buffer_half_float"));
    this.smoothFloats = Boolean(gl.getExtension("OES_texture_float_linear"));
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    this.name = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER) || "");
    this.isSoftware = /swiftshader|llvmpipe|software|basic render/i.test(this.name);
    this.largest = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.disable(gl.DITHER);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 3, -1, -1, 3]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    this.#plain();
  }

  /** Give the context back: a page has only about sixteen. */
  dispose() {
    const lose = this.gl.getExtension("WEBGL_lose_context");
    if (lose && !this.gl.isContextLost()) lose.loseContext();
  }

  /** Set the size of the canvas in pixels, which empties it where it differs. */
  fit(width: number, height: number) {
    const { canvas } = this;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  }

  // A program reads every sampler it declares, so each unit holds something of its kind from the start.
  #plain() {
    const gl = this.gl;
    for (const name of ["volume", "cells", "ownCells", "ambience", "space", "depths"] as const) {
      this.texture(name, gl.TEXTURE_3D, true);
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA8, 1, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    }
    for (const name of ["maps", "distances"] as const) {
      this.texture(name, gl.TEXTURE_2D_ARRAY, true);
      gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA8, 1, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    }
    for (const name of ["table", "weights", "picture"] as const) {
      this.texture(name, gl.TEXTURE_2D, true);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    }
  }

  /** Create a texture again, bound to its unit. */
  texture(name: Unit, target: GLenum, linear: boolean) {
    const gl = this.gl;
    gl.deleteTexture(this.#textures[name] || null);
    const texture = gl.createTexture();
    this.#textures[name] = texture;
    gl.activeTexture(gl.TEXTURE0 + UNITS[name]);
    gl.bindTexture(target, texture);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) {
      gl.texParameteri(target, side, gl.CLAMP_TO_EDGE);
    }
    for (const kind of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
      gl.texParameteri(target, kind, linear ? gl.LINEAR : gl.NEAREST);
    }
  }

  /** The program of a fragment shader with these abilities, which is linked once under a name. */
  program(name: string, shader: string, defines: string[] = []) {
    const key = [name, ...defines].join(" "),
      lines = defines.map((d) => `#define ${d}\n`).join("");
    this.programs[key] ??= linkProgram(this.gl, shader.replace("#version 300 es\n", `#version 300 es\n${lines}`));
    return this.programs[key];
  }

  /** A picture to draw into, created again when its size changes. */
  target(name: string, width: number, height: number) {
    const gl = this.gl,
      old = this.targets[name];
    if (old && old.width === width && old.height === height) return old;
    if (old) {
      gl.deleteTexture(old.texture);
      gl.deleteFramebuffer(old.buffer);
    }
    const target = { width, height, texture: gl.createTexture(), buffer: gl.createFramebuffer() };
    gl.activeTexture(gl.TEXTURE0 + UNITS.picture);
    gl.bindTexture(gl.TEXTURE_2D, target.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, this.floats ? gl.RGBA16F : gl.RGBA8, width, height);
    for (const kind of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, kind, gl.LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target.texture, 0);
    this.targets[name] = target;
    return target;
  }

  /** Draw with a program into a picture, or on the canvas. Returns the places of its uniforms. */
  use({ program, at }: Program, target: Pick<Target, "width" | "height" | "buffer"> | null) {
    const { gl, canvas } = this,
      { width, height } = target ?? canvas;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target?.buffer ?? null);
    gl.viewport(0, 0, width, height);
    gl.useProgram(program);
    return at;
  }

  /** Let all samplers of a program read their textures. */
  setSamplers(at: Uniforms) {
    for (const [sampler, unit] of Object.entries(UNITS)) this.gl.uniform1i(at(sampler), unit);
  }

  /** Let a sampler of pictures read one; null: what is bound. */
  setPicture(at: Uniforms, unit: "picture" | "second", texture: WebGLTexture | null) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + UNITS[unit]);
    gl.bindTexture(gl.TEXTURE_2D, texture ?? this.#textures.picture ?? null);
    gl.uniform1i(at(unit), UNITS[unit]);
  }
}
