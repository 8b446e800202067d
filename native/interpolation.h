/* Everything that interpolates voxels of one type; its macros are undefined again. */

typedef VOXEL NAME(Voxel);
#include "cubic.h"
#include "linear.h"
#include "rows.h"

#undef NAME
#undef VOXEL
#undef PAIR
#undef LOW
#undef HIGH
#undef ROUND
#undef LOWEST
#undef HIGHEST
#undef FOUR
#undef PART
#undef WHOLE_WEIGHTS
