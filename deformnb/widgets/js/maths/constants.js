// Constants of the package, written by: python -m deformnb.widgets.constants. Change them there.

// conditioning.py
export const LARGEST_SET = 2000;
export const SAME_PLACE = 1e-06;
export const SAME_DISPLACEMENT = 1e-09;
export const LONGEST_SHARE = 100.0;
export const COLLAPSED = 1e-06;
export const FAR_BEHIND = 12;

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

// support.py
export const MANY = 1000;
export const MOST_NEIGHBOURS = 64;

// edit_messages.py
export const LONGEST_EDIT = 1048576;
