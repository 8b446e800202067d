// The part of the ray caster's shader that finds the origin of a place of the result: maps over a plane, samples in
// space, and the regions of cuts. Lengths are physical, along the index axes of the volume (its own frame).

import CUT_CHOICE from "../../../deformnb/widgets/glsl/cut_choice.glsl";
import { MOST_REGIONS } from "../generated.ts";

export const DISPLACEMENT = `
uniform sampler2DArray maps;   // backward displacement (along u, along v) in physical units, one layer for each map
uniform sampler2D weights;     // row k: the weight of map k, from the first slice to the last
uniform int mapCount;          // of each region; its layers are consecutive
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
// Found by origin() for the last place. Half of a region's coverage is on each side of its edge.
float seen;    // share of the tissue there that has not been cut away
float closed;  // the same with a ramp a few voxels wide: below 1 a cut face is near
uniform float softness, faceWidth;

${CUT_CHOICE}
// The choice within the place's own region, into which its map leads by a depth; wide: how far it is covered
// with the ramp of a cut face.
Choice fromOwn(int own, float depth, out float wide) {
  wide = covered(depth, faceWidth);
  return begun(own, covered(depth, softness));
}

// Adds a further region into which its map leads from the place; true if it is the visible one so far.
bool fromOther(inout Choice choice, inout float wide, int region, float depth) {
  wide += covered(depth, faceWidth);
  return adds(choice, region, covered(depth, softness));
}

// A half and a half are one, nearly, as far as the digits of the textures go.
float whole(float cover, float nearly) { return cover > nearly ? 1. : cover; }
#endif

#ifdef PLANE_CUT
// Regions of the plane: layer c holds the distance from cut c, negative inside; sides[r] has a bit for each cut that
// region r is inside of.
uniform highp sampler2DArray distances; uniform mat3 toCut; uniform vec3 toCut0; uniform vec2 cutScale;
int chosen;    // the region that is seen there
uniform int regionCount, sides[${MOST_REGIONS}];

// EACH_CUT(F) is F(0) F(1) ... of all cuts: a loop takes a software renderer longer than their bodies.
float into(int region, vec2 at) {
  float depth = 1e9;
#define DEPTH(c) { float d = textureLod(distances, vec3(at, float(c)), 0.).r; \\
  depth = min(depth, ((sides[region] >> c) & 1) == 1 ? -d : d); }
  EACH_CUT(DEPTH)
  return depth;
}

vec3 fromPlane(vec3 x) {
  vec2 at = (toCut * x + toCut0).xy;
  int bits = 0, own = 0;
  float edge = 1e9;
#define SIDE(c) { float d = textureLod(distances, vec3(at, float(c)), 0.).r; \\
  edge = min(edge, abs(d)); bits |= d < 0. ? 1 << c : 0; }
  EACH_CUT(SIDE)
  for (int r = 0; r < regionCount; r++) if (sides[r] == bits) own = r;
  vec2 d = planar(x, own);
  float depth = edge - length(d); // at least: a distance changes by no more than the path length
  if (depth < .5 * faceWidth) depth = into(own, at + d * cutScale);
  float wide;
  Choice choice = fromOwn(own, depth, wide);
#ifdef BY_PLACE
  choice.cover = closedByPlace(choice.cover, edge, softness);
  wide = closedByPlace(wide, edge, faceWidth);
#else
  int others = wide < 1. ? regionCount : 0; // a loop that may have no turn: software renderers execute all of a branch
  for (int r = 0; r < others; r++) {
    if (r == own) continue;
    vec2 other = planar(x, r);
    if (fromOther(choice, wide, r, into(r, at + other * cutScale))) d = other;
  }
#endif
  chosen = choice.region;
  seen = whole(choice.cover, .999);
  closed = whole(wide, .999);
  return x + axisU * d.x + axisV * d.y;
}
#endif

#ifdef SPACE_CUT
// The same of an earlier step, sampled in space: the layers of its regions are stacked along z.
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
  float wide;
  Choice choice = fromOwn(own, move.w, wide);
#ifdef SPACE_BY_PLACE
  choice.cover = closedByPlace(choice.cover, edge, softness);
  wide = closedByPlace(wide, edge, faceWidth);
#else
  int others = wide < 1. ? spaceRegions : 0;
  for (int r = 0; r < others; r++) {
    if (r == own) continue;
    vec4 other = textureLod(space, inLayer(x, r), 0.);
    if (fromOther(choice, wide, r, other.w)) move = other;
  }
#endif
  chosenInSpace = choice.region;
  // In half precision a half and a half are not quite one.
  seen *= whole(choice.cover, .99) * textureLod(depths, inLayer(x, chosenInSpace), 0.).g;
  closed *= whole(wide, .99);
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

// The origin of the value at x of the result: the plane's displacement was done last, so it is undone first.
vec3 origin(vec3 x) {
#ifdef CUT
  seen = closed = 1.;
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
// The same by the map of the region that was found last: it continues beyond the region's edge.
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
  float u = dot(along(x + slopeStep * axisU, chosen) - d, g), v = dot(along(x + slopeStep * axisV, chosen) - d, g);
  float n = 0.;
#ifdef WEIGHTED
  n = dot(along(x + slopeStep * axisN, chosen) - d, g);
#endif
  return g + (axisU * u + axisV * v + axisN * n) / slopeStep;
#endif
}
#endif

#ifdef CUT
// Depth of a place in the tissue of the regions that were found last.
float depthOfChosen(vec3 x) {
  float depth = 1e9;
#ifdef PLANE_CUT
  depth = into(chosen, (toCut * x + toCut0).xy + planar(x, chosen) * cutScale);
#endif
#ifdef SPACE_CUT
#ifdef PLANAR
  x += along(x, chosen);
#endif
  depth = min(depth, textureLod(space, inLayer(x, chosenInSpace), 0.).w);
#endif
  return depth;
}

// Out of the gap into the visible tissue next to it; a cut face has no grain.
vec3 intoTissue(vec3 x) {
  float here = depthOfChosen(x), e = .25 * faceWidth;
  return axisU * (depthOfChosen(x + e * axisU) - here) + axisV * (depthOfChosen(x + e * axisV) - here)
    + axisN * (depthOfChosen(x + e * axisN) - here);
}
#endif`;
