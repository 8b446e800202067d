/* Loops over all voxels of a warp. Compiled once for each level of instructions, whose name LEVEL ends the table of
   functions. Compile without contraction of a * b + c, so that all levels give the same voxels. */
#include "loops.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    float low, high;
} Pair32;
typedef struct {
    int32_t low, high;
} PairInt32;
typedef struct {
    double low, high;
} Pair64;

enum { ROW = 256, /* voxels of a row that are read together: their places stay in the first cache */
       RUN = 32 /* slices that are transposed together */ };

/* How an input axis is read by a row of the output: between voxels, at one place, or at one after the other. */
enum { BETWEEN_VOXELS, AT_ONE, ALONG };

static const int VOXEL_SIZES[VOXEL_TYPES] = {1, 1, 2, 2, 4, 4, 8};

static void fill_outside(const Source *source, const int32_t *restrict inside, int n, void *out) {
#define FILL(BITS)                                                                                                     \
    case BITS / 8: {                                                                                                   \
        uint##BITS##_t *restrict to = out, fill;                                                                       \
        memcpy(&fill, source->fill, sizeof fill);                                                                      \
        for (int i = 0; i < n; i++) to[i] = inside[i] ? to[i] : fill;                                                  \
        break;                                                                                                         \
    }
    switch (VOXEL_SIZES[source->voxel_type]) { FILL(8) FILL(16) FILL(32) FILL(64) }
#undef FILL
}

static void fill_row(const Source *source, int64_t n, void *out) {
#define FILL(BITS)                                                                                                     \
    case BITS / 8: {                                                                                                   \
        uint##BITS##_t *restrict to = out, fill;                                                                       \
        memcpy(&fill, source->fill, sizeof fill);                                                                      \
        for (int64_t i = 0; i < n; i++) to[i] = fill;                                                                  \
        break;                                                                                                         \
    }
    switch (VOXEL_SIZES[source->voxel_type]) { FILL(8) FILL(16) FILL(32) FILL(64) }
#undef FILL
}

/* The sum of weights times rows; weights lie `apart` floats from each other, rows `stride`. */
static void mix_rows(const float *restrict rows, int64_t stride, const float *weights, int64_t apart, int taps,
                     int64_t n, float *restrict out) {
    if (taps == 2) {
        const float a = weights[0], b = weights[apart];
        const float *restrict next = rows + stride;
        SIMD for (int64_t i = 0; i < n; i++) out[i] = a * rows[i] + b * next[i];
    } else if (taps == 4) {
        const float a = weights[0], b = weights[apart], c = weights[2 * apart], d = weights[3 * apart];
        const float *restrict r1 = rows + stride, *restrict r2 = r1 + stride, *restrict r3 = r2 + stride;
        SIMD for (int64_t i = 0; i < n; i++) out[i] = ((a * rows[i] + b * r1[i]) + c * r2[i]) + d * r3[i];
    } else {
        for (int64_t i = 0; i < n; i++) out[i] = weights[0] * rows[i];
        for (int k = 1; k < taps; k++)
            for (int64_t i = 0; i < n; i++) out[i] += weights[k * apart] * rows[k * stride + i];
    }
}

#if defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector)
#define SHUFFLE(A, B, ...) __builtin_shufflevector(A, B, __VA_ARGS__)
#endif
#endif
#ifndef SHUFFLE /* GCC before 12 */
#define SHUFFLE(A, B, ...) __builtin_shuffle(A, B, (__typeof__(A)){__VA_ARGS__})
#endif

/* Nodes of a row at the voxels that read them. */
static void expand_row(const float *restrict nodes, const int32_t *restrict first, const float *restrict weights,
                       int taps, int64_t n, float *restrict out) {
    if (taps == 2) {
        const float *restrict w1 = weights + n;
        SIMD for (int64_t i = 0; i < n; i++) out[i] = weights[i] * nodes[first[i]] + w1[i] * nodes[first[i] + 1];
        return;
    }
    for (int64_t i = 0; i < n; i++) {
        float sum = 0;
        for (int k = 0; k < taps; k++) sum += weights[k * n + i] * nodes[first[i] + k];
        out[i] = sum;
    }
}

/* Components that lie side by side, one after the other. */
static void split_row(const float *restrict from, int64_t n, float *restrict to) {
    int64_t i = 0;
#if defined(__GNUC__)
    typedef float Four __attribute__((vector_size(16)));
    for (; i + 4 <= n; i += 4) { /* x0 y0 z0 x1, y1 z1 x2 y2, z2 x3 y3 z3 */
        Four a, b, c;
        memcpy(&a, from + 3 * i, 16);
        memcpy(&b, from + 3 * i + 4, 16);
        memcpy(&c, from + 3 * i + 8, 16);
        const Four yz = SHUFFLE(a, b, 1, 2, 4, 5), xy = SHUFFLE(b, c, 2, 3, 5, 6); /* y0 z0 y1 z1, x2 y2 x3 y3 */
        const Four x = SHUFFLE(a, xy, 0, 3, 4, 6), y = SHUFFLE(yz, xy, 0, 2, 5, 7), z = SHUFFLE(yz, c, 1, 3, 4, 7);
        memcpy(to + i, &x, 16);
        memcpy(to + n + i, &y, 16);
        memcpy(to + 2 * n + i, &z, 16);
    }
#endif
    for (; i < n; i++)
        for (int k = 0; k < 3; k++) to[k * n + i] = from[3 * i + k];
}

/* What is known of the places of a row: 0 where it is unknown. */
typedef struct {
    int32_t all_inside, all_finite;
} Check;

static int is_finite(const float *const d[3], int64_t n) {
    const float *restrict x = d[0], *restrict y = d[1], *restrict z = d[2];
    float sum = 0; /* 0 times infinity, or times no number, is no number */
    SIMD_REDUCTION(+, sum) for (int64_t i = 0; i < n; i++) sum += ((x[i] + y[i]) + z[i]) * 0.f;
    return sum == 0;
}

#define NAME(STEM) PASTE(STEM, _8)
#define VOXEL uint8_t
#define INTERLEAVE_LOW(A, B) SHUFFLE(A, B, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23)
#define INTERLEAVE_HIGH(A, B) SHUFFLE(A, B, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31)
#include "transpose.h"
#define NAME(STEM) PASTE(STEM, _16)
#define VOXEL uint16_t
#define INTERLEAVE_LOW(A, B) SHUFFLE(A, B, 0, 8, 1, 9, 2, 10, 3, 11)
#define INTERLEAVE_HIGH(A, B) SHUFFLE(A, B, 4, 12, 5, 13, 6, 14, 7, 15)
#include "transpose.h"
#define NAME(STEM) PASTE(STEM, _32)
#define VOXEL uint32_t
#define INTERLEAVE_LOW(A, B) SHUFFLE(A, B, 0, 4, 1, 5)
#define INTERLEAVE_HIGH(A, B) SHUFFLE(A, B, 2, 6, 3, 7)
#include "transpose.h"
#define NAME(STEM) PASTE(STEM, _64)
#define VOXEL uint64_t
#define INTERLEAVE_LOW(A, B) SHUFFLE(A, B, 0, 2)
#define INTERLEAVE_HIGH(A, B) SHUFFLE(A, B, 1, 3)
#include "transpose.h"

#define TRANSPOSE(WAY)                                                                                                 \
    static void WAY(int size, const void *in, int64_t in_stride, int64_t slices, int64_t columns, void *out,           \
                    int64_t out_stride) {                                                                              \
        switch (size) {                                                                                                \
            case 1: PASTE(WAY, _8)(in, in_stride, slices, columns, out, out_stride); break;                            \
            case 2: PASTE(WAY, _16)(in, in_stride, slices, columns, out, out_stride); break;                           \
            case 4: PASTE(WAY, _32)(in, in_stride, slices, columns, out, out_stride); break;                           \
            case 8: PASTE(WAY, _64)(in, in_stride, slices, columns, out, out_stride); break;                           \
        }                                                                                                              \
    }
TRANSPOSE(gather_slices)
TRANSPOSE(scatter_slices)

/* Small voxels, near places: float32 arithmetic, 32-bit indices. */
#define REAL float
#define SHARE float
#define INDEX int32_t
#define FLOOR floor_float
#define KIND _near
#define SMALL_VOXELS
#include "arithmetic.h"

/* Small voxels of large volumes. */
#define REAL double
#define SHARE float
#define INDEX int64_t
#define FLOOR floor
#define KIND _far
#define SMALL_VOXELS
#include "arithmetic.h"

/* int32 and float64 voxels, which float32 would change. */
#define REAL double
#define SHARE double
#define INDEX int64_t
#define FLOOR floor
#define KIND _wide
#include "arithmetic.h"

#define CHOOSE(CALL)                                                                                                   \
    (source->voxel_type == INT32 || source->voxel_type == FLOAT64 ? CALL(_wide) : source->is_far ? CALL(_far)         \
                                                                                                  : CALL(_near))

static int general(const Source *source, const Field *field, const Target *target) {
#define CALL(KIND) PASTE(general, KIND)(source, field, target)
    return CHOOSE(CALL);
#undef CALL
}

static int listed(const Source *source, const VoxelList *voxels) {
#define CALL(KIND) PASTE(listed, KIND)(source, voxels)
    return CHOOSE(CALL);
#undef CALL
}

static int slices(const Source *source, const PlaneField *field, const Target *target) {
#define CALL(KIND) PASTE(slices, KIND)(source, field, target)
    return CHOOSE(CALL);
#undef CALL
}

static int rows(const Source *source, const PlaneField *field, const Target *target) {
#define CALL(KIND) PASTE(rows, KIND)(source, field, target)
    return CHOOSE(CALL);
#undef CALL
}

int PASTE(deformnb_sum_lattice, LEVEL)(const LatticeSum *);
int PASTE(deformnb_edge_distances, LEVEL)(const EdgeDistances *);

EXPORT const Loops PASTE(deformnb_loops, LEVEL) = {
    general, listed, slices, rows, PASTE(deformnb_sum_lattice, LEVEL), PASTE(deformnb_edge_distances, LEVEL)};
