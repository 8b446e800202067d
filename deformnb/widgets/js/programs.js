// Programs of a graphics card: compiled, and chosen by what is shown. Needs raycast_glsl.js.

function compiled(gl, type, source) {
  const shader = gl.createShader(type);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
    throw new Error(`shader: ${gl.getShaderInfoLog(shader)}`);
  }
  return shader;
}

function linked(gl, fragment) {
  const program = gl.createProgram();
  gl.attachShader(program, compiled(gl, gl.VERTEX_SHADER, VERTEX));
  gl.attachShader(program, compiled(gl, gl.FRAGMENT_SHADER, fragment));
  gl.bindAttribLocation(program, 0, "corner");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`program: ${gl.getProgramInfoLog(program)}`);
  }
  const at = {}, count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) || 0;
  for (let i = 0; i < count; i++) {
    const { name } = gl.getActiveUniform(program, i);
    at[name] = gl.getUniformLocation(program, name);
  }
  return { program, at };
}

// From places in the volume's frame to texture coordinates over a plane: a matrix, column by column, and an offset.
function toTextures({ origin, u, v, n }, starts, lengths) {
  const scale = lengths.map((l) => (l > 0 ? 1 / l : 0));
  return [[0, 1, 2].flatMap((j) => [u, v, n].map((axis, i) => axis[j] * scale[i])),
    [u, v, n].map((axis, i) => (scale[i] ? (-dot(axis, origin) - starts[i]) * scale[i] : 0.5))];
}

/** What the shader is to be able to do, and no more: what nobody needs costs nothing. */
function definesOf(projection, planar, space, folds = false, clipped = false) {
  const cut = planar && planar.cut, early = space && space.cut, isPaper = (c) => c && c.rule === "paper";
  const wanted = {
    PLANAR: planar, WEIGHTED: planar && !planar.isReplicated, SPACE: space, WARPED: planar || space,
    MIP: projection === "mip", SHADED: projection === "shaded",
    CUT: cut || early, PLANE_CUT: cut, BY_PLACE: isPaper(cut), SPACE_CUT: early, SPACE_BY_PLACE: isPaper(early),
    FOLDS: folds && (planar || space), CLIPPED: clipped && projection === "shaded",
  };
  return Object.keys(wanted).filter((name) => wanted[name]);
}
