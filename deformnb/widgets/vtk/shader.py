"""Deformation inside VTK's own volume shader: each sample of a ray is looked up backwards.

The maps of :mod:`~deformnb.widgets.textures` become textures, and replacements in the text of VTK's shader let every
texture access of the volume, those for the gradient included, pass through them. An edit sends the maps only,
some 100 kB.

This depends on the text of VTK's shader, which may change with any version: every user compares a picture first.

At cuts the text chooses at every sample the region that is seen, as :mod:`deformnb.rbf.cuts` does. The regions are
written out one after the other, since Mesa's software renderer executes both sides of every branch anyway. Points and
cuts that move change textures only; other regions or another rule change the code.

Empty space is skipped: a ray continues to its next visible sample before it computes a gradient. As Mesa's software
renderer executes both sides of a branch, VTK's shader pays for gradient and light, six look-ups and their
displacements, also in empty space. A loop is left finally by each ray, though: the loop here has one look-up for a
sample, and the code behind it is executed only as often as the busiest of a few neighbours meets something. The samples
are the same, and so is the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Floats
from deformnb.errors import DeformError
from deformnb.volume.volume import Grid
from deformnb.widgets.bundle import SHADERS
from deformnb.widgets.messages.views import PlanarData, PlaneCutData, PlaneData, SpaceData
from deformnb.widgets.textures import FieldTextures
from deformnb.widgets.vtk.folds import REPLACED_FOR_FOLDS, fold_glsl, fold_step

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
# of that region is followed. dnb_seen is the share of the tissue at q that has not been cut away.
_CUTS_GLSL = """
vec3 dnb_at = vec3(0.0), dnb_fade_p = vec3(1.0), dnb_fade_n = vec3(1.0);
float dnb_seen = 1.0, dnb_open = 1.0;
int dnb_found = 0, dnb_home = 0;

%(choice)s

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
  float edge = -1e9;
  int own = 0;
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
    "source": """%(others)s
  dnb_seen = min(1.0, choice.cover);""",
    "paper": "dnb_seen = min(1.0, closedByPlace(choice.cover, edge, dnb_softness));",
}

_COMPONENTS = "xyz"

REPLACED_FOR_CUTS = {
    "texture3D(in_volume[0], g_dataPos)": "dnb_veil(texture3D(in_volume[0], "
    "dnb_at = dnb_inside(dnb_look(g_dataPos, -1), g_dataPos)))",
    "g_srcColor.a = computeOpacity(scalar);": "g_srcColor.a = computeOpacity(scalar) * dnb_open;",
    # A step to one side is looked up; one to the other is opposite and as far, for the opacity as for the place.
    **{
        f"texPosPvec[{k}] = texPos + {x}vec;": f"vec3 dnb_{x} = dnb_look(texPos + {x}vec, dnb_home) - dnb_at; "
        f"dnb_fade_p.{x} = dnb_seen; "
        f"dnb_fade_n.{x} = clamp(2.0 * dnb_open - dnb_seen, 0.0, 1.0); "
        f"texPosPvec[{k}] = (dnb_at + dnb_{x}) * step(texPos.{x} + {x}vec.{x}, dnb_bare_high.{x});"
        for k, x in enumerate(_COMPONENTS)
    },
    **{
        f"texPosNvec[{k}] = texPos - {x}vec;": f"texPosNvec[{k}] = (dnb_at - dnb_{x}) * "
        f"step(dnb_bare_low.{x}, texPos.{x} - {x}vec.{x});"
        for k, x in enumerate(_COMPONENTS)
    },
    **{
        f"{g}.{x} = texture3D(volume, vec3(texPos{side}vec[{k}]))[c];": f"{g}.{x} = "
        f"dnb_faded(texture3D(volume, vec3(texPos{side}vec[{k}]))[c], dnb_fade_{side.lower()}.{x});"
        for g, side in (("g1", "P"), ("g2", "N"))
        for k, x in enumerate(_COMPONENTS)
    },
}
"""Replacements in VTK's shader for cuts."""


@cache
def cut_choice() -> str:
    """The choice at a cut (Eq. 8), the same text as in the front end's shader."""
    return (SHADERS / "cut_choice.glsl").read_text(encoding="utf-8")


def cut_glsl(sides: Sequence[Sequence[bool]], rule: str, weighted: bool, inside: str, space: str) -> str:
    """The functions for these regions.

    Parameters
    ----------
    sides : for each region whether it is inside of each cut.
    rule : a name of :data:`deformnb.rbf.cuts.CUT_RULES`.
    weighted : whether maps have weights that depend on the depth.
    inside, space : further statements.
    """
    count, cuts = len(sides), len(sides[0])
    here = [f"float a{c} = dnb_away(c, {c}.0);" for c in range(cuts)]
    here += [
        f"if ({_depth(side, 'a{}')} > edge) {{ edge = {_depth(side, 'a{}')}; own = {r}; }}"
        for r, side in enumerate(sides)
    ]
    each = []
    for r, side in enumerate(sides):
        each += [
            f"vec2 d{r} = dnb_strength * dnb_map(at, {'depth' if weighted else '0.0'}, {r}.0);",
            f"e = c + d{r} * dnb_cut_scale;",
            f"float v{r} = covered({_depth(side, 'dnb_away(e, {}.0)')}, dnb_softness);",
        ]
    others = "\n  ".join(f"if (own != {r}) {{ adds(choice, {r}, v{r}); }}" for r in range(count))
    chosen = f"Choice choice = begun(own, {_indexed_name('v', count, 'own')});\n  " + _RULES[rule] % {"others": others}
    return _CUTS_GLSL % {
        "choice": cut_choice(),
        "inside": inside,
        "cuts": cuts,
        "depth": _DEPTH if weighted else "",
        "map": _MAP[weighted] % {"regions": count} if weighted else _MAP[False],
        "here": "\n  ".join(here),
        "each": "\n  ".join(each),
        "rule": f"{chosen}\n  dnb_found = choice.region;",
        "chosen": _indexed_name("d", count, "choice.region"),
        "kept": _indexed_name("d", count, "keep"),
        "space": space,
    }


def _depth(side: Sequence[bool], away: str) -> str:
    """Depth of a place within a region, of its distances to the cuts."""
    terms = [("-" if inside else "") + away.format(c) for c, inside in enumerate(side)]
    text = terms[0]
    for term in terms[1:]:
        text = f"min({text}, {term})"
    return text


def _indexed_name(name: str, count: int, index: str) -> str:
    """The variable of a number."""
    text = f"{name}{count - 1}"
    for r in reversed(range(count - 1)):
        text = f"{index} == {r} ? {name}{r} : {text}"
    return f"({text})"


RAY_HOOK = "//VTK::Base::Impl"
"""Line of VTK's template before which the text is inserted: the first words of the loop along a ray."""

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
"""Continue to the next sample that is not transparent, or leave the loop along the ray."""

REPLACED_FOR_EMPTY = {"scalar = texture3D(in_volume[0], g_dataPos);": "scalar = dnb_texel;"}
"""Look-ups that need no repetition behind it; nothing is wrong where VTK has no such words."""


_BARE = 1.5  # voxels, in addition to the one that a slope reaches

# What VTK calls things. The replacements must find all of them, else the shader does not compile or nothing moves.
_HOOK = "//VTK::ComputeGradient::Dec"
REPLACED = {
    "texture3D(in_volume[0], g_dataPos)": "texture3D(in_volume[0], "
    "dnb_at = dnb_inside(dnb_warp(g_dataPos), g_dataPos))",
    **{
        f"texPosPvec[{k}] = texPos + {x}vec;": f"vec3 dnb_{x} = dnb_warp(texPos + {x}vec) - dnb_at; "
        f"texPosPvec[{k}] = (dnb_at + dnb_{x}) * step(texPos.{x} + {x}vec.{x}, dnb_bare_high.{x});"
        for k, x in enumerate("xyz")
    },
    **{
        f"texPosNvec[{k}] = texPos - {x}vec;": f"texPosNvec[{k}] = (dnb_at - dnb_{x}) * "
        f"step(dnb_bare_low.{x}, texPos.{x} - {x}vec.{x});"
        for k, x in enumerate("xyz")
    },
}
"""Replacements in VTK's shader that displace its samples."""

_SAMPLERS = {"dnb_maps": "sampler2D", "dnb_weights": "sampler2D", "dnb_space": "sampler3D", "dnb_cuts": "sampler2D"}

# Coordinates of textures throughout. Row k of the weights belongs to map k; the maps are one below the other. A place
# outside the visible box is looked up in the corner 0, where the scene keeps background. The slope needs six
# look-ups around a sample: three displacements next to its own give their places, since a displacement is smooth.
#
# Only code of the deformation is in the shader, and no branches: Mesa's software renderer executes both sides of each,
# which made a volume without any deformation 2.7 times as slow as with VTK's own shader.
_WARP_GLSL = """
vec3 dnb_at = vec3(0.0);

vec3 dnb_inside(vec3 place, vec3 q)
{
  %(inside)s
  return place;
}

vec3 dnb_warp(vec3 q)
{
  %(planar)s
  %(space)s
  return q;
}
"""
_INSIDE = "place *= float(all(greaterThanEqual(q, dnb_low)) && all(lessThanEqual(q, dnb_high)));"
_AT = """vec4 x = vec4(q, 1.0);
  vec2 at = vec2(dot(dnb_column, x), clamp(dot(dnb_row, x), dnb_edges.x, dnb_edges.y));"""
_ADD = "q += dnb_strength * (dnb_right * d.x + dnb_down * d.y);"
_PLANAR = {
    "none": "",
    "same": f"""{_AT}
  vec2 d = texture2D(dnb_maps, at).xy;
  {_ADD}""",
    "weighted": f"""{_AT}
  vec2 d = vec2(0.0);
  float depth = clamp(dot(dnb_depth, x), 0.0, 1.0) * dnb_knots.x + dnb_knots.y;
  float count = float(dnb_count);
  for (int k = 0; k < dnb_count; k++)
  {{
    float w = texture2D(dnb_weights, vec2(depth, (float(k) + 0.5) / count)).x;
    d += w * texture2D(dnb_maps, vec2(at.x, (float(k) + at.y) / count)).xy;
  }}
  {_ADD}""",
}
_SPACE = "q += dnb_strength * texture3D(dnb_space, q * dnb_scale + dnb_shift).xyz;"


class VolumeWarp:
    """Displaces what one actor of VTK samples; used by the thread that renders, and by no other.

    Parameters
    ----------
    actor : a volume with a GPU mapper in ``window``, rendered at least once.
    window : its render window.

    Attributes
    ----------
    kind : of the text that is in the shader now.
    """

    def __init__(self, actor: Any, window: Any) -> None:
        self._property = actor.GetShaderProperty()
        self._uniforms = self._property.GetFragmentCustomUniforms()
        self._window = window
        self._textures = {name: _Texture(window) for name in _SAMPLERS}
        self._set_plain()
        self._textures["dnb_maps"].load(np.zeros((1, 1, 2)))
        self._textures["dnb_weights"].load(np.zeros((1, 1, 1)))
        self._textures["dnb_space"].load(np.zeros((1, 1, 1, 4)))
        self._textures["dnb_cuts"].load(np.zeros((1, 1, 1)))
        self._bind()
        self._is_boxed = self._is_red = self._is_lit = False
        self.kind: Any = None
        self._what: tuple[str, bool, Any] = ("none", False, None)
        self._inject(*self._what)

    def _set_plain(self) -> None:
        """Every uniform once: VTK declares in the shader those that have a value when it is made."""
        u = self._uniforms
        u.SetUniformi("dnb_count", 0)
        u.SetUniformf("dnb_strength", 1.0)
        u.SetUniformf("dnb_softness", 1.0)
        u.SetUniformf("dnb_is_mip", 0.0)
        u.SetUniformf("dnb_fold_row", 0.0)
        for name in ("dnb_column", "dnb_row", "dnb_depth", "dnb_cut_column", "dnb_cut_row"):
            u.SetUniform4f(name, [0.0] * 4)
        for name in ("dnb_right", "dnb_down", "dnb_scale", "dnb_shift", "dnb_low", "dnb_bare_low", "dnb_fold_step"):
            u.SetUniform3f(name, [0.0] * 3)
        u.SetUniform3f("dnb_high", [1.0] * 3)
        u.SetUniform3f("dnb_bare_high", [1.0] * 3)
        for name in ("dnb_edges", "dnb_knots", "dnb_cut_edges", "dnb_cut_scale"):
            u.SetUniform2f(name, [0.0] * 2)

    def _bind(self) -> None:
        for name, texture in self._textures.items():
            self._uniforms.SetUniformi(name, texture.unit())

    def _inject(self, planar: str, space: bool, cut: Any) -> None:
        """Write the code into VTK's shader, which is compiled again if that differs from before."""
        self._what = (planar, space, cut)
        is_red = self._is_red and (planar != "none" or space)
        wanted = (*self._what, self._is_boxed, is_red, self._is_lit)
        if self.kind == wanted:
            return
        self.kind = wanted
        self._property.ClearAllFragmentShaderReplacements()
        add = self._property.AddFragmentShaderReplacement
        inside, more = _INSIDE if self._is_boxed else "", _SPACE if space else ""
        ours = (
            _WARP_GLSL % {"planar": _PLANAR[planar], "space": more, "inside": inside}
            if cut is None
            else cut_glsl(cut[0], cut[1], planar == "weighted", inside, more)
        )
        add(_HOOK, True, f"{ours}{fold_glsl(cut is not None) if is_red else ''}\n{_HOOK}", False)
        if self._is_lit:  # else a sample costs no more than to find out that it is empty
            add(RAY_HOOK, True, f"{SKIP_EMPTY}{RAY_HOOK}", False)
            for theirs, replacement in REPLACED_FOR_EMPTY.items():  # VTK takes the words in the order of the alphabet
                add(theirs, False, replacement, True)
        for name, kind in _SAMPLERS.items():  # vtkUniforms has numbers only: declared as int, turned into a sampler
            add(f"uniform int {name};", False, f"uniform {kind} {name};", True)
        replaced = REPLACED if cut is None else REPLACED_FOR_CUTS
        for theirs, replacement in (replaced | REPLACED_FOR_FOLDS if is_red else replaced).items():
            add(theirs, False, replacement, True)

    def set_box(self, low: Floats, high: Floats, lattice: Grid, is_cut: Floats | None = None) -> None:
        """Set the visible box, in indices (i, j, k) of the sampled lattice, from whose edges VTK starts.

        Parameters
        ----------
        is_cut : (2, 3), 1 for each side, first the low ones, that is a cut through the tissue. Its face is lit
            deeper than a slope reaches: an even inside has none, and VTK leaves that dark.
        """
        n = np.asarray(lattice.shape[::-1])
        self._is_boxed = bool((low > 1e-6).any() or (high < n - 1 - 1e-6).any())
        self._uniforms.SetUniform3f("dnb_low", ((low - 1e-4 + 0.5) / n).tolist())
        self._uniforms.SetUniform3f("dnb_high", ((high + 1e-4 + 0.5) / n).tolist())
        bare = np.zeros((2, 3)) if is_cut is None else _BARE * is_cut
        self._uniforms.SetUniform3f("dnb_bare_low", ((low - 1e-4 + 0.5 + bare[0]) / n).tolist())
        self._uniforms.SetUniform3f("dnb_bare_high", ((high + 1e-4 + 0.5 - bare[1]) / n).tolist())
        self._inject(*self._what)

    def set_strength(self, strength: float) -> None:
        """1 deforms, 0 shows the volume as it is, without another shader."""
        self._uniforms.SetUniformf("dnb_strength", strength)

    def set_folds(self, is_red: bool) -> None:
        """Paint the tissue that the maps invert red, or not, which is another shader."""
        self._is_red = is_red
        self._inject(*self._what)

    def set_row(self, row: int) -> None:
        """The picture's row from below that the window starts with: stripes continue from one part to the next."""
        self._uniforms.SetUniformf("dnb_fold_row", float(row))

    def set_projection(self, is_mip: bool, is_lit: bool) -> None:
        """Set maximum intensity projection, for which clipped voxels are background, and gradient shading."""
        self._uniforms.SetUniformf("dnb_is_mip", float(is_mip))
        self._is_lit = is_lit
        self._inject(*self._what)

    def set_maps(self, maps: FieldTextures | None, lattice: Grid, first: Floats) -> None:
        """Displace by these maps; None for no deformation.

        Parameters
        ----------
        lattice : of the voxels that VTK has.
        first : the maps' frame starts there, an index (i, j, k) of ``lattice``.
        """
        self._window.MakeCurrent()
        planar = maps.content.planar if maps is not None else None
        space = maps.content.space if maps is not None else None
        cut = planar["cut"] if planar is not None else None
        self._inject(
            "none" if planar is None else "same" if planar["isReplicated"] else "weighted",
            space is not None,
            cut and (tuple(map(tuple, cut["sides"])), cut["rule"]),
        )
        if maps is None:
            return
        # A texture coordinate q is the length scale q + shift of the maps' frame.
        spacing = np.asarray(lattice.spacing)
        scale, shift = spacing * lattice.shape[::-1], -(0.5 + first) * spacing
        self._uniforms.SetUniform3f("dnb_fold_step", (fold_step(maps, lattice) / scale).tolist())
        if planar is not None:
            self._set_planar(planar, maps, scale, shift)
        if planar is not None and cut is not None:
            self._uniforms.SetUniformf("dnb_softness", planar["softness"])
            self._set_cut(cut, maps.buffer("distances"), planar["plane"], scale, shift)
        if space is not None:
            self._set_space(space, maps.buffer("space"), scale, shift)
        self._bind()

    def _set_planar(self, about: PlanarData, given: FieldTextures, scale: Floats, shift: Floats) -> None:
        count, rows, columns = about["shape"]
        regions = len(about["cut"]["sides"]) if about["cut"] is not None else 1
        maps = np.frombuffer(given.buffer("maps"), "<f4").reshape(count * rows, columns, 2)
        weights = np.frombuffer(given.buffer("weights"), "<f4").reshape(count // regions, -1)
        if max(count * rows, weights.shape[1]) > self._textures["dnb_maps"].largest:
            raise DeformError(f"{count} maps of {rows} rows are more than the GPU takes; use fewer.")
        plane, u = about["plane"], self._uniforms
        (a, b), (da, db) = about["origin"], about["spacing"]
        u.SetUniform4f("dnb_column", _raster_transform(plane, "u", scale, shift, a, columns * da, 0.5 / columns))
        u.SetUniform4f("dnb_row", _raster_transform(plane, "v", scale, shift, b, rows * db, 0.5 / rows))
        c0, c1 = about["depth"]
        u.SetUniform4f("dnb_depth", _raster_transform(plane, "n", scale, shift, c0, c1 - c0) if c1 > c0 else [0.0] * 4)
        u.SetUniform2f("dnb_edges", [0.5 / rows, 1 - 0.5 / rows])  # one map does not run into the next
        n = weights.shape[1]
        u.SetUniform2f("dnb_knots", [(n - 1) / n, 0.5 / n])
        u.SetUniform3f("dnb_right", (np.asarray(plane["u"]) / scale).tolist())
        u.SetUniform3f("dnb_down", (np.asarray(plane["v"]) / scale).tolist())
        u.SetUniformi("dnb_count", count)
        self._textures["dnb_maps"].load(maps)
        self._textures["dnb_weights"].load(weights[..., None])

    def _set_cut(self, about: PlaneCutData, samples: bytes, plane: PlaneData, scale: Floats, shift: Floats) -> None:
        count, rows, columns = about["shape"]
        if count * rows > self._textures["dnb_cuts"].largest:
            raise DeformError(f"{count} cuts are more than the GPU takes; use fewer.")
        (a, b), (da, db) = about["origin"], about["spacing"]
        u = self._uniforms
        u.SetUniform4f("dnb_cut_column", _raster_transform(plane, "u", scale, shift, a, columns * da, 0.5 / columns))
        u.SetUniform4f("dnb_cut_row", _raster_transform(plane, "v", scale, shift, b, rows * db, 0.5 / rows))
        u.SetUniform2f("dnb_cut_edges", [0.5 / rows, 1 - 0.5 / rows])
        u.SetUniform2f("dnb_cut_scale", [1 / (columns * da), 1 / (rows * db)])
        self._textures["dnb_cuts"].load(np.frombuffer(samples, "<f4").reshape(count * rows, columns, 1))

    def _set_space(self, about: SpaceData, samples: bytes, scale: Floats, shift: Floats) -> None:
        n, spacing = np.asarray(about["shape"]), np.asarray(about["spacing"])
        values = np.zeros((*n[::-1], 4), np.float32)  # four: GPUs are slow with three
        values[..., :3] = np.frombuffer(samples, "<f4").reshape(*n[::-1], 3) / scale
        self._uniforms.SetUniform3f("dnb_scale", (scale / spacing / n).tolist())
        self._uniforms.SetUniform3f("dnb_shift", (((shift - about["origin"]) / spacing + 0.5) / n).tolist())
        self._textures["dnb_space"].load(values)

    def close(self) -> None:
        """Give back the textures, before the window goes."""
        self._window.MakeCurrent()
        for texture in self._textures.values():
            texture.close()


def _raster_transform(
    plane: PlaneData,
    axis: Literal["u", "v", "n"],
    scale: Floats,
    shift: Floats,
    start: float,
    length: float,
    offset: float = 0.0,
) -> list[float]:
    """Four numbers that turn a texture coordinate of the volume into one of a raster over a plane."""
    w = np.asarray(plane[axis])
    return [
        *(w * scale / length).tolist(),
        float((w @ (shift - np.asarray(plane["origin"])) - start) / length + offset),
    ]


class _Texture:
    """Samples on the GPU, interpolated linearly and constant beyond the outermost."""

    def __init__(self, window: Any) -> None:
        from vtkmodules.vtkRenderingOpenGL2 import vtkTextureObject

        self._texture = vtkTextureObject()
        self._texture.SetContext(window)
        self._texture.SetMinificationFilter(vtkTextureObject.Linear)
        self._texture.SetMagnificationFilter(vtkTextureObject.Linear)
        for axis in "STR":
            getattr(self._texture, f"SetWrap{axis}")(vtkTextureObject.ClampToEdge)
        self.largest = int(vtkTextureObject.GetMaximumTextureSize(window))

    def load(self, samples: NDArray[Any]) -> None:
        """Samples (rows, columns, components), or (slices, rows, columns, components)."""
        from vtkmodules.util.vtkConstants import VTK_FLOAT

        values = np.ascontiguousarray(samples, np.float32)
        make: Any = self._texture.Create2DFromRaw if values.ndim == 3 else self._texture.Create3DFromRaw
        self._texture.Deactivate()
        if not make(*reversed(values.shape[:-1]), values.shape[-1], VTK_FLOAT, values):
            raise DeformError("the GPU took no texture of displacements.")
        self._texture.Activate()

    def unit(self) -> int:
        """Texture unit that holds it."""
        return int(self._texture.GetTextureUnit())

    def close(self) -> None:
        self._texture.Deactivate()
        self._texture.ReleaseGraphicsResources(self._texture.GetContext())
