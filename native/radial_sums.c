/* Sums over centres at the places of a lattice. Compiled once for each level of instructions, as voxel_warp.c. */
#include "loops.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { COLUMNS = 64, /* columns that are summed together */
       ROWS = 32 /* rows that share a list of centres */ };

#define KERNELS(DO)                                                                                                    \
    DO(wendland_c0)                                                                                                    \
    DO(wendland_c2)                                                                                                    \
    DO(wendland_c4)                                                                                                    \
    DO(gaussian)                                                                                                       \
    DO(multiquadric)                                                                                                   \
    DO(inverse_multiquadric)                                                                                           \
    DO(inverse_quadratic)                                                                                              \
    DO(linear)                                                                                                         \
    DO(thin_plate)                                                                                                     \
    DO(cubic)                                                                                                          \
    DO(quintic)

#define KERNEL(KIND) KERNEL_##KIND,
enum { KERNELS(KERNEL) };
#undef KERNEL

#define NAME(STEM) PASTE(STEM, _f32)
#define REAL float
#define BITS uint32_t
#define SQRT sqrtf
#define FLOOR floor_float
#define WIDTH 23
#define BIAS 127
#define ROOT_HALF 0x3F3504F3u
#define TWO_TO_WIDTH 0x4B000000u
#define TWO_TO_WIDTH_AND_BIAS (8388608.f + 127)
#define LOG_2_HIGH 0.693145751953125f
#define LOG_2_LOW 1.4286068202862268e-06f
#define LOG_SERIES(Z) (0.333333881909f + (Z) * (0.199887707824f + (Z) * 0.149358640111f))
#define LEAST_EXPONENT (-87.f)
#define EXP_TERMS 7
#include "sums.h"
#undef NAME
#undef REAL
#undef BITS
#undef SQRT
#undef FLOOR
#undef WIDTH
#undef BIAS
#undef ROOT_HALF
#undef TWO_TO_WIDTH
#undef TWO_TO_WIDTH_AND_BIAS
#undef LOG_2_HIGH
#undef LOG_2_LOW
#undef LOG_SERIES
#undef LEAST_EXPONENT
#undef EXP_TERMS

#define NAME(STEM) PASTE(STEM, _f64)
#define REAL double
#define BITS uint64_t
#define SQRT sqrt
#define FLOOR floor
#define WIDTH 52
#define BIAS 1023
#define ROOT_HALF 0x3FE6A09E667F3BCDu
#define TWO_TO_WIDTH 0x4330000000000000u
#define TWO_TO_WIDTH_AND_BIAS (4503599627370496. + 1023)
#define LOG_2_HIGH 0.6931471804855391
#define LOG_2_LOW 7.440617110012397e-11
#define LOG_SERIES(Z)                                                                                                  \
    (0.333333333333333486 +                                                                                            \
     (Z) * (0.199999999999492548 +                                                                                     \
            (Z) * (0.142857143131850435 +                                                                              \
                   (Z) * (0.111111055387920751 +                                                                       \
                          (Z) * (0.0909144643700562618 + (Z) * (0.0766580419567697147 + (Z) * 0.0730886585948460551))))))
#define LEAST_EXPONENT (-708.)
#define EXP_TERMS 13
#include "sums.h"

int PASTE(deformnb_sum_lattice, LEVEL)(const LatticeSum *job) {
    return job->is_double ? sum_lattice_f64(job) : sum_lattice_f32(job);
}
