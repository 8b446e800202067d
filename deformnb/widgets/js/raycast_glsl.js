// The shaders of the ray caster. Lengths are physical, along the index axes of the volume (its own frame); every ray
// sample x of the result takes its value from the place x + D(x) of the input, as the paper does on its GPU.

const VERTEX = `#version 300 es
in vec2 corner;
void main() { gl_Position = vec4(corner, 0., 1.); }`;

// A uniform of the shader has this many places; below 1024 numbers every card takes it.
const MOST_REGIONS = 32;

const DISPLACEMENT = `
uniform sampler2DArray maps;   // backward displacement (along u, along v) in physical units, one layer for each map
uniform sampler2D weights;     // row k: the weight of map k, from the first slice to the last
uniform int mapCount;          // of each region; its layers lie one after the other
uniform mat3 toMap; uniform vec3 toMap0;     // from the volume's frame to (column, row, depth) in texture coordinates
uniform vec3 axisU, axisV, axisN;
uniform sampler3D space; uniform vec3 toSpace, toSpace0;

#ifdef PLANAR
vec2 planar(vec3 x, int region) {
  vec3 m = toMap * x + toMap0;
#ifdef WEIGHTED
  vec2 d = vec2(0.);
  for (int k = 0; k < mapCount; k++) {
    float w = textureLod(weights, vec2(m.z, (float(k) + .5) / float(mapCount)), 0.).r;
    if (w != 0.) d += w * textureLod(maps, vec3(m.xy, float(region * mapCount + k)), 0.).rg;
  }
  return d;
#else
  return textureLod(maps, vec3(m.xy, float(region)), 0.).rg;
#endif
}

vec3 along(vec3 x, int region) {
  vec2 d = planar(x, region);
  return axisU * d.x + axisV * d.y;
}
#endif

#ifndef PLANE_CUT
const int chosen = 0;
#endif

#ifdef CUT
// What origin() has found at the place asked for last. Of a region's coverage half lies on each side of its edge.
float seen;    // share of what is there that has not been cut away
float closed;  // the same with a ramp a few voxels wide: below 1 a cut face is near
float firm;    // how far one may go until another region may count, or what counts may begin or end
uniform float softness, faceWidth;

float covered(float depth, float width) { return clamp(.5 + depth / width, 0., 1.); }
#endif

#ifdef PLANE_CUT
// Regions of the plane: layer c holds the distance from cut c, negative inside; sides[r] has a bit for each cut that
// region r lies inside of. Something comes from a region as far as its own map leads into that region.
uniform highp sampler2DArray distances; uniform mat3 toCut; uniform vec3 toCut0; uniform vec2 cutScale;
int chosen;    // the region that is seen there
uniform int cutCount, regionCount, sides[${MOST_REGIONS}];

float into(int region, vec2 at, int count) {
  float depth = 1e9;
  for (int c = 0; c < count; c++) {
    float d = textureLod(distances, vec3(at, float(c)), 0.).r;
    depth = min(depth, ((sides[region] >> c) & 1) == 1 ? -d : d);
  }
  return depth;
}

vec3 fromPlane(vec3 x) {
  vec2 at = (toCut * x + toCut0).xy;
  int bits = 0, own = 0;
  float edge = 1e9;
  for (int c = 0; c < cutCount; c++) {
    float d = textureLod(distances, vec3(at, float(c)), 0.).r;
    edge = min(edge, abs(d));
    if (d < 0.) bits |= 1 << c;
  }
  for (int r = 0; r < regionCount; r++) if (sides[r] == bits) own = r;
  vec2 d = planar(x, own);
  chosen = own;
  float depth = edge - length(d); // at least: a distance changes by no more than the way
  // Loops that may have no turn instead of branches: renderers without a card execute both sides of those.
  bool isNear = depth < .5 * faceWidth;
  float known = into(own, at + d * cutScale, isNear ? cutCount : 0);
  if (isNear) depth = known;
  isNear = depth < .5 * faceWidth;
  firm = min(edge, abs(depth) - .5 * softness);
#ifdef BY_PLACE
  seen = min(1., covered(depth, softness) / covered(edge, softness));
  closed = min(1., covered(depth, faceWidth) / covered(edge, faceWidth));
#else
  float best = covered(depth, softness);
  bool isOwn = best >= .5;
  seen = best;
  closed = covered(depth, faceWidth);
  for (int r = 0; r < (isNear ? regionCount : 0); r++) {
    if (r == own) continue;
    vec2 other = planar(x, r);
    float far = into(r, at + other * cutScale, cutCount), cover = covered(far, softness);
    firm = min(firm, abs(far) - .5 * softness);
    seen += cover;
    closed += covered(far, faceWidth);
    if (!isOwn && cover > best) { best = cover; chosen = r; d = other; }
  }
  if (seen > .999) seen = 1.; // a half and a half are one
  if (closed > .999) closed = 1.;
#endif
  return x + axisU * d.x + axisV * d.y;
}
#endif

#ifdef SPACE_CUT
// The same of an earlier step, sampled in space: the layers of its regions lie one behind the other along z.
uniform sampler3D depths; uniform int spaceRegions; uniform float spaceEdge;
int chosenInSpace;

vec3 inLayer(vec3 x, int region) {
  vec3 p = x * toSpace + toSpace0;
  return vec3(p.xy, (float(region) + clamp(p.z, spaceEdge, 1. - spaceEdge)) / float(spaceRegions));
}

vec3 fromSpace(vec3 x) {
  int own = 0;
  float edge = -1e9;
  for (int r = 0; r < spaceRegions; r++) {
    float d = textureLod(depths, inLayer(x, r), 0.).r;
    if (d > edge) { edge = d; own = r; }
  }
  vec4 move = textureLod(space, inLayer(x, own), 0.);
  float depth = move.w, best = covered(depth, softness), wide = covered(depth, faceWidth), total = best;
  chosenInSpace = own;
  firm = min(firm, min(edge, abs(depth) - .5 * softness));
#ifdef SPACE_BY_PLACE
  total /= covered(max(edge, 0.), softness);
  wide /= covered(max(edge, 0.), faceWidth);
#else
  bool isOwn = best >= .5, isSure = wide >= 1.;
  for (int r = 0; r < (isSure ? 0 : spaceRegions); r++) {
    if (r == own) continue;
    vec4 other = textureLod(space, inLayer(x, r), 0.);
    float cover = covered(other.w, softness);
    firm = min(firm, abs(other.w) - .5 * softness);
    total += cover;
    wide += covered(other.w, faceWidth);
    if (!isOwn && cover > best) { best = cover; chosenInSpace = r; move = other; }
  }
#endif
  // In half precision a half and a half are not quite one.
  seen *= (total > .99 ? 1. : total) * textureLod(depths, inLayer(x, chosenInSpace), 0.).g;
  closed *= wide > .99 ? 1. : wide;
  return x + move.xyz;
}
#endif

#ifdef SPACE
vec3 sampled(vec3 x) {
#ifdef SPACE_CUT
  return x + textureLod(space, inLayer(x, chosenInSpace), 0.).xyz;
#else
  return x + textureLod(space, x * toSpace + toSpace0, 0.).xyz;
#endif
}
#endif

// Where the value at x of the result comes from: the plane's displacement was done last, so it is undone first.
vec3 origin(vec3 x) {
#ifdef CUT
  seen = closed = 1.;
  firm = 1e9;
#endif
#ifdef PLANE_CUT
  x = fromPlane(x);
#elif defined(PLANAR)
  x += along(x, 0);
#endif
#ifdef SPACE_CUT
  x = fromSpace(x);
#elif defined(SPACE)
  x = sampled(x);
#endif
  return x;
}

#ifdef WARPED
// The same, as the region says that was found last: beyond its edge its own map goes on.
vec3 onward(vec3 x) {
#ifdef PLANAR
  x += along(x, chosen);
#endif
#ifdef SPACE
  x = sampled(x);
#endif
  return x;
}

uniform float slopeStep;
// The gradient of f(x + D(x)) is the transposed Jacobian of x + D(x) times the gradient of f there.
vec3 pulledBack(vec3 x, vec3 at, vec3 g) {
#ifdef SPACE
  vec3 r = vec3(dot(onward(x + slopeStep * axisU) - at, g), dot(onward(x + slopeStep * axisV) - at, g),
                dot(onward(x + slopeStep * axisN) - at, g)) / slopeStep;
  return axisU * r.x + axisV * r.y + axisN * r.z;
#else
  vec3 d = at - x;
  float u = dot(along(x + slopeStep * axisU, chosen) - d, g), v = dot(along(x + slopeStep * axisV, chosen) - d, g), n = 0.;
#ifdef WEIGHTED
  n = dot(along(x + slopeStep * axisN, chosen) - d, g);
#endif
  return g + (axisU * u + axisV * v + axisN * n) / slopeStep;
#endif
}
#endif

#ifdef CUT
// How deep a place lies in the matter of the regions that were found last.
float depthOfChosen(vec3 x) {
  float depth = 1e9;
#ifdef PLANE_CUT
  depth = into(chosen, (toCut * x + toCut0).xy + planar(x, chosen) * cutScale, cutCount);
#endif
#ifdef SPACE_CUT
#ifdef PLANAR
  x += along(x, chosen);
#endif
  depth = min(depth, textureLod(space, inLayer(x, chosenInSpace), 0.).w);
#endif
  return depth;
}

// Out of the gap into what is seen beside it; a cut face has no grain.
vec3 intoMatter(vec3 x) {
  float here = depthOfChosen(x), e = .25 * faceWidth;
  return axisU * (depthOfChosen(x + e * axisU) - here) + axisV * (depthOfChosen(x + e * axisV) - here)
    + axisN * (depthOfChosen(x + e * axisN) - here);
}
#endif`;

const FRAGMENT = `#version 300 es
precision highp float; precision highp int;
precision highp sampler2D; precision highp sampler3D; precision highp sampler2DArray;
uniform sampler3D volume;      // gradient (128 is zero) and value
uniform sampler3D blocks;      // rings of transparent blocks around each, largest value near it
uniform sampler3D ambience;    // how much light reaches a place
uniform sampler2D table;       // colour and opacity of one step
uniform vec3 eye, right, up, ahead; uniform float bend;
uniform vec2 place, resolution, shift; uniform float phase;
uniform vec3 boxLow, boxHigh, toTexture, toTexture0, blockScale, blockSize, slope;
uniform float stepLength, outside, outsideOpacity, certain, reach, rate;
uniform vec3 lamp, halfway, fillLamp; uniform vec2 grey;
uniform vec3 ink;
out vec4 color;
${DISPLACEMENT}
${FOLDS_GLSL}

// A warm lamp with a soft edge between light and shade, a cool weak one, a broad gloss with a small bright one in it, and
// darker where a surface turns away, as skin and wax have it. What lies deeper is a little darker too.
vec3 lit(vec3 rgb, vec3 g, float light, float depth) {
  float size = length(g);
  vec3 n = g / max(size, 1e-6);
  float facing = dot(n, ahead);
  if (facing < 0.) { n = -n; facing = -facing; } // g points into what is denser; seen from within, it is turned around
  float key = max(.16 - dot(n, lamp), 0.) / 1.16, fill = max(-dot(n, fillLamp), 0.), shine = max(-dot(n, halfway), 0.);
  float s2 = shine * shine, s4 = s2 * s2, s8 = s4 * s4, s16 = s8 * s8;
  float gloss = .09 * s8 + .27 * s16 * s16;
  float rim = 1. - .25 * (1. - facing) * (1. - facing);
  vec3 diffuse = light * (.36 + vec3(.17, .19, .22) * fill) + vec3(.96, .92, .87) * key * (.42 + .58 * light);
  float sure = clamp(size * certain, 0., 1.); // where all is alike there is no surface to be lit
  vec3 surface = rgb * diffuse * rim + vec3(gloss * light);
  return mix(rgb * .8 * (.3 + .7 * light), surface, sure) * (1. - .22 * depth);
}

void main() {
  vec2 pixel = gl_FragCoord.xy - place;      // of this picture, which may be one of two side by side
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
  // Neighbouring rays start at different depths: what would be rings becomes a fine grain, and later frames average it.
  float noise = fract(52.9829189 * fract(dot(floor(pixel), vec2(.06711056, .00583715))) + phase);
  // How far one may go until the place of origin may have left its block, upwards and downwards along each axis.
  vec3 upward = blockSize / max(ray + slope, vec3(1e-6)), downward = blockSize / max(slope - ray, vec3(1e-6));
  vec4 sum = vec4(0.); float most = 0.;
#ifdef FOLDS
  bool turned = false;                        // what is seen of a largest value
#endif
  float t = t0 + noise * stepLength, nearT = dot(.5 * (boxLow + boxHigh) - start, ray) - .25 * reach;
  for (int i = 0; i < 4096; i++) {
    if (t >= t1) break;
    vec3 x = start + t * ray, from = origin(x), q = from * toTexture + toTexture0;
    vec3 cell = clamp(q, 0., 1.) * blockScale;
#ifdef CUT
    float fixedFor = max(0., firm) / rate;     // nothing of the cuts changes until then
    if (seen <= .002) { most = max(most, outside); t += max(1., floor(fixedFor / stepLength)) * stepLength; continue; }
#endif
    vec2 block = textureLod(blocks, cell, 0.).rg * 255.;
#ifdef MIP
    bool skip = block.g <= most * 255. + .5;
    float rings = 1.;                         // the value counts the neighbours too
#else
    bool skip = block.r > .5;
    float rings = block.r - 1.;
#endif
    if (skip) {
      vec3 inside = fract(cell * vec3(textureSize(blocks, 0)));
      vec3 room = min((1. - inside + rings) * upward, (inside + rings) * downward);
      float free = min(min(room.x, room.y), room.z);
#ifdef CUT
      free = min(free, fixedFor);
#endif
      t += max(1., floor(free / stepLength)) * stepLength;
      continue;
    }
    t += stepLength;
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
    if (out_ && outsideOpacity == 0.) continue;
    vec4 here = out_ ? vec4(vec3(128. / 255.), outside) : textureLod(volume, q, 0.);
    vec4 rgba = textureLod(table, vec2(here.a * (255. / 256.) + .5 / 256., .5), 0.);
    if (rgba.a <= 0.) continue;
#ifdef CUT
    rgba.a *= seen;
#endif
#ifdef FOLDS
    if (folded(x, from)) rgba.rgb = foldRed(rgba.rgb);
#endif
#ifdef SHADED
    float light = textureLod(ambience, clamp(q, 0., 1.), 0.).r;
    vec3 g = here.rgb * 255. - 128.;
#ifdef WARPED
    // Where the box cuts through the body its face is lit, not the grain of the voxels behind it.
    if (t - t0 < 2. * stepLength && nearest < t0) g = face * 127.;
    else if (dot(g, g) * certain * certain > .01) g = pulledBack(x, from, g); // elsewhere no surface is lit
#endif
#ifdef CUT
    int faces = closed < 1. ? 1 : 0;
    for (int once = 0; once < faces; once++) { // no branch: see above
      vec3 inward = intoMatter(x);
      inward /= max(length(inward), 1e-4);
      // A face that looks away lies behind its matter: what is seen there is the surface in front of it.
      float open = smoothstep(0., 1., 2. - 2. * closed) * smoothstep(-.05, .25, dot(inward, ray));
      g = mix(g, inward * 127., open);
      light = mix(light, max(light, .9), open); // what was deep inside lies open now
    }
#endif
    rgba.rgb = lit(rgba.rgb, g, light, clamp((t - nearT) / (.6 * reach), 0., 1.));
#endif
    sum += (1. - sum.a) * rgba.a * vec4(rgba.rgb, 1.);
    if (sum.a > .985) { sum /= sum.a; break; }
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
#endif
}`;

// Lays the picture over the background: a light that falls off towards the corners, so that dark bodies stand out.
const PRESENT = `#version 300 es
precision highp float;
uniform sampler2D picture; uniform vec2 resolution; uniform float parts; uniform vec3 centre, corner;
out vec4 color;
void main() {
  vec2 at = gl_FragCoord.xy / resolution;
  vec4 c = textureLod(picture, at, 0.);
  vec2 d = (vec2(fract(at.x * parts), at.y) - vec2(.5, .56)) * vec2(1.1, 1.25);
  vec3 behind = mix(centre, corner, smoothstep(0., .62, dot(d, d) * 1.6));
  behind += (fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(.06711056, .00583715)))) - .5) / 255.;
  color = vec4(c.rgb + (1. - c.a) * behind, 1.);
}`;
