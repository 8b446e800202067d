// The shaders of the ray caster. Lengths are physical, along the index axes of the volume (its own frame); every ray
// sample x of the result takes its value from the place x + D(x) of the input, as the paper does on its GPU.

import { DISPLACEMENT } from "./displacement_shader.ts";
import { FOLDS_GLSL } from "./fold_mesh.ts";
import { OPACITY_SHARE } from "./volume_blocks.ts";

const LITTLE = "0.05"; // share of the light that one sample stops at most, if several steps are taken at once
const MOST_STEPS = "8.";

export const VERTEX = `#version 300 es
in vec2 corner;
void main() { gl_Position = vec4(corner, 0., 1.); }`;

export const FRAGMENT = `#version 300 es
precision highp float; precision highp int;
precision highp sampler2D; precision highp sampler3D; precision highp sampler2DArray;
uniform sampler3D volume;      // gradient (128 is zero) and value
uniform sampler3D cells;       // of the result: rings of empty cells around each, its largest opacity or value
uniform sampler3D ambience;    // how much light reaches a place
uniform sampler2D table;       // colour and opacity of one step
uniform vec3 eye, right, up, ahead; uniform float bend;
uniform vec2 place, resolution, shift; uniform float phase;
uniform vec3 boxLow, boxHigh, toTexture, toTexture0, cellCount, toCells, toCells0;
uniform vec3 middle;           // of the visible box when nothing is cut away
#ifdef CLIPPED
uniform vec3 openLow, openHigh; uniform float bareDepth; // 1 where a side of the box is a cut; how deep its face is lit
#endif
uniform float stepLength, outside, outsideOpacity, certain, reach;
uniform float layers;          // thicknesses that the opacities of cells are of, in a step
uniform float opaque;          // share of the light that is stopped, from which on a ray ends
uniform float steep;           // opacity of a step, from which on its surface is looked for
uniform vec3 lamp, halfway, fillLamp; uniform vec2 grey;
uniform vec3 ink;
out vec4 color;
${DISPLACEMENT}
${FOLDS_GLSL}

// A warm lamp with a soft edge between light and shade, a cool weak one, a broad gloss with a small bright one in it,
// and darker where a surface turns away, as with skin and wax. Deeper tissue is a little darker too.
vec3 lit(vec3 rgb, vec3 g, float light, float depth) {
  float size = length(g);
  vec3 n = g / max(size, 1e-6);
  float facing = dot(n, ahead);
  if (facing < 0.) { n = -n; facing = -facing; } // g points into denser tissue; seen from within, it is turned around
  float key = max(.16 - dot(n, lamp), 0.) / 1.16, fill = max(-dot(n, fillLamp), 0.), shine = max(-dot(n, halfway), 0.);
  float s2 = shine * shine, s4 = s2 * s2, s8 = s4 * s4, s16 = s8 * s8;
  float gloss = .09 * s8 + .27 * s16 * s16;
  float rim = 1. - .25 * (1. - facing) * (1. - facing);
  vec3 diffuse = light * (.36 + vec3(.17, .19, .22) * fill) + vec3(.96, .92, .87) * key * (.42 + .58 * light);
  float sure = clamp(size * certain, 0., 1.); // where all is uniform there is no surface to be lit
  vec3 surface = rgb * diffuse * rim + vec3(gloss * light);
  return mix(rgb * .8 * (.3 + .7 * light), surface, sure) * (1. - .22 * depth);
}

// Numbers from 0 to 1 that differ between neighbours, the same for a pixel in every picture.
float hashed(ivec2 p) {
  uint h = uint(p.x) * 1597334677u ^ uint(p.y) * 3812015801u;
  h = (h ^ h >> 16) * 2246822519u;
  h = (h ^ h >> 13) * 3266489917u;
  return float((h ^ h >> 16) >> 8) / 16777216.;
}

// The same without what changes slowly from pixel to pixel, which would be seen as blotches, or as a weave where it is
// regular: nearly blue noise. The last line makes all numbers from 0 to 1 about equally frequent.
float grain(vec2 pixel) {
  ivec2 p = ivec2(pixel), d = ivec2(1, 0);
  float around = hashed(p + d.xy) + hashed(p - d.xy) + hashed(p + d.yx) + hashed(p - d.yx);
  return 1. / (1. + exp(-5.27 * (hashed(p) - .25 * around)));
}

void main() {
  vec2 pixel = gl_FragCoord.xy - place; // of this picture, which may be one of two side by side
  vec2 at = (pixel + shift) / resolution * 2. - 1.;
  vec3 start = eye + at.x * right + at.y * up, ray = ahead;
  float nearest = -1e30;
  if (bend > 0.) { ray = normalize(at.x * right + at.y * up + ahead / bend); start = eye - ahead / bend; nearest = 0.; }
  vec3 safe = mix(ray, vec3(1e-7), lessThan(abs(ray), vec3(1e-7)));
  vec3 a = (boxLow - start) / safe, b = (boxHigh - start) / safe, lo = min(a, b), hi = max(a, b);
  float t0 = max(max(max(lo.x, lo.y), lo.z), nearest), t1 = min(min(hi.x, hi.y), hi.z);
  color = vec4(0.);
  if (t0 >= t1) return;
  vec3 face = vec3(lessThanEqual(vec3(t0), lo)) * sign(ray);
#ifdef CLIPPED
  float isOpen = nearest < t0 ? min(1., dot(max(face, 0.), openLow) + dot(max(-face, 0.), openHigh)) : 0.;
#endif
  // Neighbouring rays start at different depths: what would be rings becomes a fine grain, and later frames average it.
  float noise = fract(grain(pixel) + phase);
  vec3 cell0 = start * toCells + toCells0, toCell = safe * toCells;
  vec3 perCell = 1. / abs(toCell), isForth = step(0., toCell);
  vec4 sum = vec4(0.); float most = 0., entries = float(textureSize(table, 0).x - 1);
  float thin = 0.;                            // opacity of the sample before
#ifdef FOLDS
  bool turned = false;                        // the side seen of a largest value
#endif
  float t = t0 + noise * stepLength, nearT = dot(middle - start, ray) - .25 * reach;
  // A software renderer executes all of a loop's body for all rays: so rare work is kept out of frequent bodies.
  for (int i = 0; i < 4096; i++) {
    vec3 x, from, q; vec4 here, rgba = vec4(0.);
    float steps = 1.;                         // that one sample represents
    for (int j = 0; j < 4096; j++) {
      for (int k = 0; k < 4096; k++) {
        if (t >= t1) break;
        vec3 cell = clamp(cell0 + t * toCell, vec3(0.), cellCount - .001);
        vec2 about = texelFetch(cells, ivec3(cell), 0).rg;
#ifdef MIP
        bool isEmpty = about.g <= most + .002;
        float rings = 1.;
#else
        bool isEmpty = about.r > 0.;
        float rings = max(about.r * 255. - 1., 0.);
#endif
        vec3 inside = fract(cell), room = (rings + mix(inside, 1. - inside, isForth)) * perCell;
        float leave = max(1., ceil(min(min(room.x, room.y), room.z) / stepLength));
#ifndef MIP
        // As many steps together as stop little light in the densest of the cell, but none of another cell; the face of
        // a body that the box cuts through is seen in single ones.
        float stopped = max((1. - sum.a) * layers * ${OPACITY_SHARE} * about.g, 1e-6);
        steps = t - t0 < 3. * stepLength ? 1. : clamp(floor(${LITTLE} / stopped), 1., min(leave, ${MOST_STEPS}));
#endif
        if (!isEmpty) break;
        thin = 0.;
        t += leave * stepLength;
      }
      if (t >= t1) break;
      x = start + (t + .5 * (steps - 1.) * stepLength) * ray; // the middle of the steps it represents
      from = origin(x);
      q = from * toTexture + toTexture0;
      t += steps * stepLength;
      bool out_ = any(lessThan(q, vec3(0.))) || any(greaterThanEqual(q, vec3(1.)));
#ifdef MIP
      float value = out_ ? outside : textureLod(volume, q, 0.).a;
#ifdef CUT
      value = mix(outside, value, seen);
#endif
#ifdef FOLDS
      if (value > most) turned = folded(x, from);
#endif
      most = max(most, value);
#else
      here = out_ ? vec4(vec3(128. / 255.), outside) : textureLod(volume, q, 0.);
      rgba = texelFetch(table, ivec2(here.a * entries + .5, 0), 0);
#ifdef CUT
      rgba.a *= step(.002, seen) * seen;
#endif
      if (rgba.a > 0.) break;
      thin = 0.;
#endif
    }
#ifdef MIP
    break;
#else
    if (rgba.a <= 0.) break;
#ifdef FOLDS
    if (folded(x, from)) rgba.rgb = foldRed(rgba.rgb);
#endif
#ifdef SHADED
#ifdef OCCLUDED
    float light = textureLod(ambience, clamp(q, 0., 1.), 0.).r;
#else
    float light = 1.;
#endif
    vec3 g = here.rgb * 255. - 128.;
    // Where a long step has come upon something dense its surface is a part of it back, with a different slope.
    if (rgba.a > 4. * thin + steep) {
      vec3 deep = q, bare = q - stepLength * ray * toTexture;
      for (int once = 0; once < 3; once++) {
        vec3 between = .5 * (deep + bare);
        float v = textureLod(volume, between, 0.).a;
        if (texelFetch(table, ivec2(v * entries + .5, 0), 0).a > .4 * rgba.a) deep = between;
        else bare = between;
      }
      g = textureLod(volume, deep, 0.).rgb * 255. - 128.;
    }
    thin = rgba.a;
#ifdef WARPED
    // Where the box cuts through the body its face is lit, not the grain of the voxels behind it.
    if (t - t0 < 2. * stepLength && nearest < t0) g = face * 127.;
    else if (dot(g, g) * certain * certain > .01) g = pulledBack(x, from, g); // elsewhere no surface is lit
#endif
#ifdef CLIPPED
    float bare = isOpen * clamp(1.5 - (t - t0) / bareDepth, 0., 1.); // deep tissue is exposed there
    g = mix(g, face * 127., bare);
    light = mix(light, max(light, .9), bare);
#endif
#ifdef CUT
    int faces = closed < 1. ? 1 : 0;
    for (int once = 0; once < faces; once++) { // no branch: see above
      vec3 inward = intoTissue(x);
      inward /= max(length(inward), 1e-4);
      // A face turned away is behind its tissue: the surface in front of it is visible there.
      float open = smoothstep(0., 1., 2. - 2. * closed) * smoothstep(-.05, .25, dot(inward, ray));
      g = mix(g, inward * 127., open);
      light = mix(light, max(light, .9), open); // deep tissue is exposed now
    }
#endif
    rgba.rgb = lit(rgba.rgb, g, light, clamp((t - nearT) / (.6 * reach), 0., 1.));
#endif
    sum += (1. - sum.a) * (1. - pow(1. - min(rgba.a, .9999), steps)) * vec4(rgba.rgb, 1.);
    if (sum.a > opaque) { sum /= sum.a; break; }
#endif
  }
#ifdef MIP
  float v = clamp((most - grey.x) / (grey.y - grey.x), 0., 1.);
  vec3 tone = ink;
#ifdef FOLDS
  if (turned) tone = foldRed(tone);
#endif
  color = vec4(tone * v, v);
#else
  color = sum;
#ifdef SHADED
  // Anything brighter than white would be an even patch: from three quarters on, brightness approaches white.
  vec3 bright = max(color.rgb / max(color.a, 1e-6) - .75, 0.);
  color.rgb -= color.a * (bright - .25 * (1. - exp(-4. * bright)));
#endif
#endif
}`;

export const SIDE_SAMPLES = 64; // along each edge of a side of the box

// Finds tissue beyond the six sides of the box, which are side by side.
export const SIDES = `#version 300 es
precision highp float; precision highp int;
precision highp sampler2D; precision highp sampler3D; precision highp sampler2DArray;
uniform sampler3D volume;
uniform vec3 boxLow, boxHigh, toTexture, toTexture0;
uniform vec3 beyond;           // how far, in shares of the box
uniform float tissue;          // values above are tissue
out vec4 color;
${DISPLACEMENT}
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy);
  int side = p.x / ${SIDE_SAMPLES}, axis = side / 2;
  vec2 along = (vec2(p.x % ${SIDE_SAMPLES}, p.y) + .5) / float(${SIDE_SAMPLES});
  float across = side % 2 == 0 ? -beyond[axis] : 1. + beyond[axis];
  vec3 share = axis == 0 ? vec3(across, along) : axis == 1 ? vec3(along.x, across, along.y) : vec3(along, across);
  vec3 q = origin(mix(boxLow, boxHigh, share)) * toTexture + toTexture0;
  bool isInside = all(greaterThanEqual(q, vec3(0.))) && all(lessThan(q, vec3(1.)));
  float there = isInside && textureLod(volume, q, 0.).a > tissue ? 1. : 0.;
#ifdef CUT
  there *= step(.5, seen);
#endif
  color = vec4(there);
}`;

// Composites the picture over the background: a light that falls off towards the corners, so that dark bodies stand out. A
// smaller picture is enlarged by the cubic of Mitchell and Netravali (1988), without its four corners, which are small.
export const PRESENT = `#version 300 es
precision highp float;
uniform sampler2D picture, second; uniform float share; // opacity of the second picture over the first
uniform vec2 extent, secondExtent, resolution; uniform float parts; uniform vec3 centre, corner;
out vec4 color;
vec4 look(sampler2D seen, vec2 extent, vec2 t) {
  return textureLod(seen, clamp(t, vec2(.5), extent - .5) / vec2(textureSize(seen, 0)), 0.);
}
vec4 smoothly(sampler2D seen, vec2 extent, vec2 t) {
  vec2 base = floor(t - .5) + .5, f = t - base;
  vec2 w0 = ((-7. * f + 15.) * f - 9.) * f / 18. + 1. / 18., w3 = (7. * f - 6.) * f * f / 18.;
  vec2 w2 = ((-21. * f + 27.) * f + 9.) * f / 18. + 1. / 18., w12 = 1. - w0 - w3;
  vec2 mid = base + w2 / w12, low = base - 1., high = base + 2.;
  vec4 sum = look(seen, extent, mid) * w12.x * w12.y + look(seen, extent, vec2(mid.x, low.y)) * w12.x * w0.y
    + look(seen, extent, vec2(low.x, mid.y)) * w0.x * w12.y + look(seen, extent, vec2(high.x, mid.y)) * w3.x * w12.y
    + look(seen, extent, vec2(mid.x, high.y)) * w12.x * w3.y;
  return clamp(sum / (w12.x + w12.y - w12.x * w12.y), 0., 1.);
}
vec4 at(sampler2D seen, vec2 extent) {
  vec2 t = gl_FragCoord.xy / resolution * extent;
  return extent.x < resolution.x ? smoothly(seen, extent, t) : look(seen, extent, t);
}
void main() {
  vec2 place = gl_FragCoord.xy / resolution;
  vec4 c = at(picture, extent), over = share > 0. ? at(second, secondExtent) : c;
  vec2 d = (vec2(fract(place.x * parts), place.y) - vec2(.5, .56)) * vec2(1.1, 1.25);
  vec3 behind = mix(centre, corner, smoothstep(0., .62, dot(d, d) * 1.6));
  behind += (fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(.06711056, .00583715)))) - .5) / 255.;
  vec3 first = min(c.rgb + (1. - c.a) * behind, 1.); // as they would be seen alone: highlights are brighter than white
  color = vec4(mix(first, min(over.rgb + (1. - over.a) * behind, 1.), share), 1.);
}`;
