// The choice at a cut (Eq. 8), of the plane as of space, in WebGL's shader as in VTK's. A place may come from each
// region, as far as the region's own map leads into that region: so far it is covered. What is seen there is of the
// place's own region if at least half of the place is covered from it, else of the region that covers most.
struct Choice { int region; float best, cover; bool isSure; };

// How far a place is covered from a depth within a region: half of it at the edge, which is softened over a width.
float covered(float depth, float width) { return clamp(.5 + depth / width, 0., 1.); }

// The choice as far as the place's own region goes.
Choice begun(int own, float cover) { return Choice(own, cover, cover, cover >= .5); }

// Adds another region; true if it is the one that is seen so far.
bool adds(inout Choice choice, int region, float cover) {
  bool isBest = !choice.isSure && cover > choice.best;
  choice.cover += cover;
  if (isBest) { choice.best = cover; choice.region = region; }
  return isBest;
}

// The rule "paper" has no other region; what of the place belongs to its own one is all that can be covered.
// edge: distance of the place to that region's boundary.
float closedByPlace(float cover, float edge, float width) { return cover / covered(max(edge, 0.), width); }
