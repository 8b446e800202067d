"""Empty space in VTK's own volume shader: a ray goes on to its next sample that is seen before it asks for a slope.

Mesa's software renderer executes both sides of a branch, so VTK's shader pays for slope and light, six look-ups and
their displacements, also where nothing is. A loop is left for good by each ray, though: the loop here has one look-up
for a sample, and what comes behind it is executed only as often as the busiest of a few neighbours meets something. The
samples are the same, and so is the picture.
"""

from __future__ import annotations

RAY_HOOK = "//VTK::Base::Impl"
"""What of VTK's template the text stands before: the first words of the loop along a ray."""

# How a ray ends is written as VTK does it behind each sample.
SKIP_EMPTY = """bool dnb_ends = false;
    vec4 dnb_texel;
    while (true)
    {
      dnb_texel = texture3D(in_volume[0], g_dataPos);
      if (computeOpacity(vec4((dnb_texel * in_volume_scale[0] + in_volume_bias[0]).r)) > 0.0) { break; }
      g_dataPos += g_dirStep;
      if (any(greaterThan(max(g_dirStep, vec3(0.0)) * (g_dataPos - in_texMax[0]), vec3(0.0))) ||
          any(greaterThan(min(g_dirStep, vec3(0.0)) * (g_dataPos - in_texMin[0]), vec3(0.0))) ||
          g_currentT >= g_terminatePointMax)
      {
        dnb_ends = true;
        break;
      }
      ++g_currentT;
    }
    if (dnb_ends) { break; }
    """
"""Goes on to the next sample that is not transparent, or leaves the loop along the ray."""

REPLACED_FOR_EMPTY = {"scalar = texture3D(in_volume[0], g_dataPos);": "scalar = dnb_texel;"}
"""What need not be looked up again behind it; nothing is wrong where VTK has no such words."""
