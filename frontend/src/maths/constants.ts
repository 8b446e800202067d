// Constants of the package, written by: python -m deformnb.widgets.constants. Change them there.

// conditioning.py
export const LARGEST_SET = 2000;
export const SAME_PLACE = 1e-06;
export const SAME_DISPLACEMENT = 1e-09;
export const LONGEST_SHARE = 100.0;
export const COLLAPSED = 1e-06;
export const FAR_BEHIND = 12;
export const SAME_DISTANCE = 1e-06;
export const NEAREST = 4;
export const NEAREST_AND_EQUAL = 12;

// cross_validation.py
export const MOST_LEFT_OUT = 512;

// exactness.py
export const RESIDUAL = 1e-07;
export const ROUNDING = 1e-10;
export const MOST_MISSED = 0.0001;

// interpolant.py
export const MOST_GAIN = 100000.0;
export const STEEP = 10.0;

// kernels.py
export const TINY = 1e-30;

// folds.py
export const NEARLY_FOLDED = 0.05;

// checks.py
export const LARGEST_COORDINATE = 1000000000000000.0;

// trends.py
export const NO_ANGLE = 1e-06;
export const FLAT = 1e-07;
export const THIN = 0.25;
export const THIN_BEND = 0.0625;
export const SOFTNESS = 0.5;
export const LEAST_SPREAD = 0.0001;

// regions.py
export const LARGEST_SHAPE = 512;

// rigid.py
export const SAME_MOTION = 1e-06;

// slits.py
export const MOST_SLITS = 3;

// stages.py
export const MOST_STAGES = 64;

// occlusion.py
export const AMBIENT_CELL = 4;
export const AMBIENT_NEAR = [1, 1.0];
export const AMBIENT_FAR = [3, 4.0];
export const AMBIENT_AHEAD = 3.0;
export const AMBIENT_EVEN = 0.04;

// units.py
export const UNIT_METRES = {"Ym": 1e+24, "Zm": 1e+21, "Em": 1e+18, "Pm": 1000000000000000.0, "Tm": 1000000000000.0, "Gm": 1000000000.0, "Mm": 1000000.0, "km": 1000.0, "hm": 100.0, "m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "\u00b5m": 1e-06, "nm": 1e-09, "pm": 1e-12, "fm": 1e-15, "am": 1e-18, "zm": 1e-21, "ym": 1e-24, "\u00c5": 1e-10, "in": 0.0254, "ft": 0.3048, "yd": 0.9144, "mi": 1609.344, "pc": 3.085677581491367e+16};
export const UNIT_WORDS = {"Ym": "Ym", "yottameter": "Ym", "yottameters": "Ym", "yottametre": "Ym", "yottametres": "Ym", "Zm": "Zm", "zettameter": "Zm", "zettameters": "Zm", "zettametre": "Zm", "zettametres": "Zm", "Em": "Em", "exameter": "Em", "exameters": "Em", "exametre": "Em", "exametres": "Em", "Pm": "Pm", "petameter": "Pm", "petameters": "Pm", "petametre": "Pm", "petametres": "Pm", "Tm": "Tm", "terameter": "Tm", "terameters": "Tm", "terametre": "Tm", "terametres": "Tm", "Gm": "Gm", "gigameter": "Gm", "gigameters": "Gm", "gigametre": "Gm", "gigametres": "Gm", "Mm": "Mm", "megameter": "Mm", "megameters": "Mm", "megametre": "Mm", "megametres": "Mm", "km": "km", "kilometer": "km", "kilometers": "km", "kilometre": "km", "kilometres": "km", "hm": "hm", "hectometer": "hm", "hectometers": "hm", "hectometre": "hm", "hectometres": "hm", "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m", "dm": "dm", "decimeter": "dm", "decimeters": "dm", "decimetre": "dm", "decimetres": "dm", "cm": "cm", "centimeter": "cm", "centimeters": "cm", "centimetre": "cm", "centimetres": "cm", "mm": "mm", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm", "\u00b5m": "\u00b5m", "micrometer": "\u00b5m", "micrometers": "\u00b5m", "um": "\u00b5m", "\u03bcm": "\u00b5m", "\ufffdm": "\u00b5m", "\u00c2\u00b5m": "\u00b5m", "micron": "\u00b5m", "microns": "\u00b5m", "mcm": "\u00b5m", "micrometre": "\u00b5m", "micrometres": "\u00b5m", "nm": "nm", "nanometer": "nm", "nanometers": "nm", "nanometre": "nm", "nanometres": "nm", "pm": "pm", "picometer": "pm", "picometers": "pm", "picometre": "pm", "picometres": "pm", "fm": "fm", "femtometer": "fm", "femtometers": "fm", "femtometre": "fm", "femtometres": "fm", "am": "am", "attometer": "am", "attometers": "am", "attometre": "am", "attometres": "am", "zm": "zm", "zeptometer": "zm", "zeptometers": "zm", "zeptometre": "zm", "zeptometres": "zm", "ym": "ym", "yoctometer": "ym", "yoctometers": "ym", "yoctometre": "ym", "yoctometres": "ym", "\u00c5": "\u00c5", "angstrom": "\u00c5", "angstroms": "\u00c5", "\u212b": "\u00c5", "A": "\u00c5", "ang": "\u00c5", "in": "in", "inch": "in", "inches": "in", "\"": "in", "ft": "ft", "foot": "ft", "feet": "ft", "yd": "yd", "yard": "yd", "yards": "yd", "mi": "mi", "mile": "mi", "miles": "mi", "pc": "pc", "parsec": "pc", "parsecs": "pc"};
export const UNIT_LOWER_WORDS = {"parsecs": "pc", "parsec": "pc", "miles": "mi", "mile": "mi", "yards": "yd", "yard": "yd", "feet": "ft", "foot": "ft", "inches": "in", "inch": "in", "ang": "\u00c5", "angstroms": "\u00c5", "angstrom": "\u00c5", "yoctometres": "ym", "yoctometre": "ym", "yoctometers": "ym", "yoctometer": "ym", "zeptometres": "zm", "zeptometre": "zm", "zeptometers": "zm", "zeptometer": "zm", "attometres": "am", "attometre": "am", "attometers": "am", "attometer": "am", "femtometres": "fm", "femtometre": "fm", "femtometers": "fm", "femtometer": "fm", "picometres": "pm", "picometre": "pm", "picometers": "pm", "picometer": "pm", "nanometres": "nm", "nanometre": "nm", "nanometers": "nm", "nanometer": "nm", "nm": "nm", "micrometres": "\u00b5m", "micrometre": "\u00b5m", "mcm": "\u00b5m", "microns": "\u00b5m", "micron": "\u00b5m", "\u00e2\u00b5m": "\u00b5m", "um": "\u00b5m", "micrometers": "\u00b5m", "micrometer": "\u00b5m", "millimetres": "mm", "millimetre": "mm", "millimeters": "mm", "millimeter": "mm", "mm": "mm", "centimetres": "cm", "centimetre": "cm", "centimeters": "cm", "centimeter": "cm", "cm": "cm", "decimetres": "dm", "decimetre": "dm", "decimeters": "dm", "decimeter": "dm", "metres": "m", "metre": "m", "meters": "m", "meter": "m", "hectometres": "hm", "hectometre": "hm", "hectometers": "hm", "hectometer": "hm", "kilometres": "km", "kilometre": "km", "kilometers": "km", "kilometer": "km", "megametres": "Mm", "megametre": "Mm", "megameters": "Mm", "megameter": "Mm", "gigametres": "Gm", "gigametre": "Gm", "gigameters": "Gm", "gigameter": "Gm", "terametres": "Tm", "terametre": "Tm", "terameters": "Tm", "terameter": "Tm", "petametres": "Pm", "petametre": "Pm", "petameters": "Pm", "petameter": "Pm", "exametres": "Em", "exametre": "Em", "exameters": "Em", "exameter": "Em", "zettametres": "Zm", "zettametre": "Zm", "zettameters": "Zm", "zettameter": "Zm", "yottametres": "Ym", "yottametre": "Ym", "yottameters": "Ym", "yottameter": "Ym"};
export const NO_UNITS = ["", "pixel", "pixels", "px", "voxel", "voxels", "vx", "unknown", "none", "null", "?", "arbitrary", "reference frame", "referenceframe", "unitless", "dimensionless", "index"];

// edit_messages.py
export const LONGEST_EDIT = 1048576;
