"""Cuts in VTK's own volume shader: text that decides at every sample which region is seen, as deformnb.cuts does.

The regions are written out one after the other, since Mesa's software renderer executes both sides of every branch
anyway. Points and cuts that move change textures only; the text is another one for other regions or another rule.
"""

from __future__ import annotations

from collections.abc import Sequence

_DEPTH = "float depth = clamp(dot(dnb_depth, x), 0.0, 1.0) * dnb_knots.x + dnb_knots.y;"

_MAP = {
    False: "return texture2D(dnb_maps, vec2(at.x, (region + at.y) / float(dnb_count))).xy;",
    True: """vec2 d = vec2(0.0);
  float count = float(dnb_count), maps = count / %(regions)s.0;
  for (int k = 0; k < int(maps); k++)
  {
    float w = texture2D(dnb_weights, vec2(depth, (float(k) + 0.5) / maps)).x;
    d += w * texture2D(dnb_maps, vec2(at.x, (region * maps + float(k) + at.y) / count)).xy;
  }
  return d;""",
}

# dnb_look: where the value at q comes from. keep < 0 chooses the region, which dnb_veil keeps in dnb_home; else the map
# of that region is followed. dnb_seen is the share of what is at q that has not been cut away.
_CUTS_GLSL = """
vec3 dnb_at = vec3(0.0), dnb_fade_p = vec3(1.0), dnb_fade_n = vec3(1.0);
float dnb_seen = 1.0, dnb_open = 1.0;
int dnb_found = 0, dnb_home = 0;

vec3 dnb_inside(vec3 place, vec3 q)
{
  %(inside)s
  return place;
}

vec2 dnb_map(vec2 at, float depth, float region)
{
  %(map)s
}

float dnb_away(vec2 at, float cut)
{
  vec2 p = vec2(at.x, clamp(at.y, dnb_cut_edges.x, dnb_cut_edges.y));
  return texture2D(dnb_cuts, vec2(p.x, (cut + p.y) / %(cuts)s.0)).x;
}

vec3 dnb_look(vec3 q, int keep)
{
  vec4 x = vec4(q, 1.0);
  vec2 at = vec2(dot(dnb_column, x), clamp(dot(dnb_row, x), dnb_edges.x, dnb_edges.y));
  %(depth)s
  vec2 c = vec2(dot(dnb_cut_column, x), dot(dnb_cut_row, x)), e;
  float total = 0.0, cover, most = -1e9;
  int own = 0, best;
  %(here)s
  %(each)s
  %(rule)s
  vec2 d = keep < 0 ? %(chosen)s : %(kept)s;
  q += dnb_right * d.x + dnb_down * d.y;
  %(space)s
  return q;
}

vec4 dnb_veil(vec4 value)
{
  dnb_home = dnb_found;
  dnb_open = dnb_seen;
  return mix(texture3D(in_volume[0], vec3(0.0)), value, max(dnb_open, 1.0 - dnb_is_mip));
}

float dnb_faded(float value, float seen)
{
  return mix(texture3D(in_volume[0], vec3(0.0)).x, value, seen);
}
"""

_RULES = {
    "source": """best = own;
  dnb_seen = min(1.0, total);
  if (cover < 0.5)
  {
    %(others)s
  }""",
    "paper": """best = own;
  dnb_seen = min(1.0, cover / clamp(0.5 + most / dnb_softness, 0.5, 1.0));""",
}

_AXES = "xyz"

REPLACED_FOR_CUTS = {
    "texture3D(in_volume[0], g_dataPos)":
        "dnb_veil(texture3D(in_volume[0], dnb_at = dnb_inside(dnb_look(g_dataPos, -1), g_dataPos)))",
    "g_srcColor.a = computeOpacity(scalar);": "g_srcColor.a = computeOpacity(scalar) * dnb_open;",
    # A step to one side is looked up; one to the other is as far the other way, for the opacity as for the place.
    **{f"texPosPvec[{k}] = texPos + {x}vec;":
       f"vec3 dnb_{x} = dnb_look(texPos + {x}vec, dnb_home) - dnb_at; dnb_fade_p.{x} = dnb_seen; "
       f"dnb_fade_n.{x} = clamp(2.0 * dnb_open - dnb_seen, 0.0, 1.0); "
       f"texPosPvec[{k}] = (dnb_at + dnb_{x}) * step(texPos.{x} + {x}vec.{x}, dnb_bare_high.{x});"
       for k, x in enumerate(_AXES)},
    **{f"texPosNvec[{k}] = texPos - {x}vec;":
       f"texPosNvec[{k}] = (dnb_at - dnb_{x}) * step(dnb_bare_low.{x}, texPos.{x} - {x}vec.{x});"
       for k, x in enumerate(_AXES)},
    **{f"{g}.{x} = texture3D(volume, vec3(texPos{side}vec[{k}]))[c];":
       f"{g}.{x} = dnb_faded(texture3D(volume, vec3(texPos{side}vec[{k}]))[c], dnb_fade_{side.lower()}.{x});"
       for g, side in (("g1", "P"), ("g2", "N")) for k, x in enumerate(_AXES)},
}
"""What takes the place of VTK's words where there are cuts."""


def cut_glsl(sides: Sequence[Sequence[bool]], rule: str, weighted: bool, inside: str, space: str) -> str:
    """The functions for these regions.

    Parameters
    ----------
    sides : for each region whether it lies inside of each cut.
    rule : a name of :data:`deformnb.cuts.CUT_RULES`.
    weighted : whether maps have weights that depend on the depth.
    inside, space : further statements.
    """
    count, cuts = len(sides), len(sides[0])
    here = [f"float a{c} = dnb_away(c, {c}.0);" for c in range(cuts)]
    here += [f"if ({_depth(side, 'a{}')} > most) {{ most = {_depth(side, 'a{}')}; own = {r}; }}"
             for r, side in enumerate(sides)]
    each = []
    for r, side in enumerate(sides):
        each += [f"vec2 d{r} = dnb_strength * dnb_map(at, {'depth' if weighted else '0.0'}, {r}.0);",
                 f"e = c + d{r} * dnb_cut_scale;",
                 f"float v{r} = clamp(0.5 + {_depth(side, 'dnb_away(e, {}.0)')} / dnb_softness, 0.0, 1.0);",
                 f"total += v{r};"]
    others = "\n    ".join(f"if (v{r} > cover) {{ cover = v{r}; best = {r}; }}" for r in range(count))
    chosen = f"cover = {_picked('v', count, 'own')};\n  " + _RULES[rule] % {"others": others}
    return _CUTS_GLSL % {
        "inside": inside, "map": _MAP[weighted] % {"regions": count} if weighted else _MAP[False], "cuts": cuts,
        "depth": _DEPTH if weighted else "", "here": "\n  ".join(here), "each": "\n  ".join(each),
        "rule": f"{chosen}\n  dnb_found = best;", "chosen": _picked("d", count, "best"),
        "kept": _picked("d", count, "keep"), "space": space,
    }


def _depth(side: Sequence[bool], away: str) -> str:
    """How deep a place lies within a region, of its distances to the cuts."""
    terms = [("-" if inside else "") + away.format(c) for c, inside in enumerate(side)]
    text = terms[0]
    for term in terms[1:]:
        text = f"min({text}, {term})"
    return text


def _picked(name: str, count: int, index: str) -> str:
    """The variable of a number."""
    text = f"{name}{count - 1}"
    for r in reversed(range(count - 1)):
        text = f"{index} == {r} ? {name}{r} : {text}"
    return f"({text})"
