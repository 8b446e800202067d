/* All loops for one type of arithmetic: REAL, SHARE, INDEX, FLOOR, and the end of names, KIND. They are undefined again at
   the end. SMALL_VOXELS: for those that float32 does not change. */

#define NAME(STEM) PASTE(STEM, KIND)
#include "places.h"
#undef NAME

#define VOXEL uint8_t
#define NAME(STEM) PASTE(PASTE(STEM, _8), KIND)
#include "nearest.h"
#define VOXEL uint16_t
#define NAME(STEM) PASTE(PASTE(STEM, _16), KIND)
#include "nearest.h"
#define VOXEL uint32_t
#define NAME(STEM) PASTE(PASTE(STEM, _32), KIND)
#include "nearest.h"
#define VOXEL uint64_t
#define NAME(STEM) PASTE(PASTE(STEM, _64), KIND)
#include "nearest.h"

/* PAIR holds two neighbours along x, LOW and HIGH are their values; FOUR, where a word of 32 bits can, holds two pairs, and
   PART its values. ROUND gives a voxel, halves upwards. */
#ifdef SMALL_VOXELS

#define VOXEL uint8_t
#define NAME(STEM) PASTE(PASTE(STEM, _u8), KIND)
#define PAIR uint16_t
#define LOW(P) ((float)((P) & 255))
#define HIGH(P) ((float)((P) >> 8))
#define FOUR uint32_t
#define WHOLE_WEIGHTS
#define PART(W, K) ((float)(int32_t)((W) >> 8 * (K) & 255))
#define ROUND(V) ((uint8_t)(int32_t)((V) + 0.5f))
#define LOWEST 0
#define HIGHEST 255
#include "interpolation.h"

#define VOXEL int8_t
#define NAME(STEM) PASTE(PASTE(STEM, _i8), KIND)
#define PAIR uint16_t
#define LOW(P) ((float)(int8_t)(P))
#define HIGH(P) ((float)(int8_t)((P) >> 8))
#define ROUND(V) ((int8_t)(int32_t)floor_float((V) + 0.5f))
#define LOWEST -128
#define HIGHEST 127
#include "interpolation.h"

#define VOXEL uint16_t
#define NAME(STEM) PASTE(PASTE(STEM, _u16), KIND)
#define PAIR uint32_t
#define LOW(P) ((float)(int32_t)((P) & 65535))
#define HIGH(P) ((float)(int32_t)((P) >> 16))
#define ROUND(V) ((uint16_t)(int32_t)((V) + 0.5f))
#define LOWEST 0
#define HIGHEST 65535
#include "interpolation.h"

#define VOXEL int16_t
#define NAME(STEM) PASTE(PASTE(STEM, _i16), KIND)
#define PAIR uint32_t
#define LOW(P) ((float)(int16_t)(P))
#define HIGH(P) ((float)(int16_t)((P) >> 16))
#define ROUND(V) ((int16_t)(int32_t)floor_float((V) + 0.5f))
#define LOWEST -32768
#define HIGHEST 32767
#include "interpolation.h"

#define VOXEL float
#define NAME(STEM) PASTE(PASTE(STEM, _f32), KIND)
#define PAIR Pair32
#define LOW(P) ((P).low)
#define HIGH(P) ((P).high)
#define ROUND(V) (V)
#include "interpolation.h"

#define VOXEL_CASES READ(UINT8, u8) READ(INT8, i8) READ(UINT16, u16) READ(INT16, i16) READ(FLOAT32, f32)

#else

#define VOXEL int32_t
#define NAME(STEM) PASTE(PASTE(STEM, _i32), KIND)
#define PAIR PairInt32
#define LOW(P) ((double)(P).low)
#define HIGH(P) ((double)(P).high)
#define ROUND(V) ((int32_t)floor((V) + 0.5))
#define LOWEST -2147483648.
#define HIGHEST 2147483647.
#include "interpolation.h"

#define VOXEL double
#define NAME(STEM) PASTE(PASTE(STEM, _f64), KIND)
#define PAIR Pair64
#define LOW(P) ((P).low)
#define HIGH(P) ((P).high)
#define ROUND(V) (V)
#include "interpolation.h"

#define VOXEL_CASES READ(INT32, i32) READ(FLOAT64, f64)

#endif

#define NAME(STEM) PASTE(STEM, KIND)
#include "jobs.h"
#undef NAME

#undef VOXEL_CASES
#undef REAL
#undef SHARE
#undef INDEX
#undef FLOOR
#undef KIND
#undef SMALL_VOXELS
