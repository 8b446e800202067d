/* The jobs of the loops, as Python fills them in (deformnb/native/jobs.py has the same fields in the same
   order). Arrays are [z, y, x]; axes 0, 1, 2 are z, y, x everywhere. */
#ifndef LOOPS_H
#define LOOPS_H

#include <math.h>
#include <stdint.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define PASTE2(A, B) A##B
#define PASTE(A, B) PASTE2(A, B)
#define PRAGMA(TEXT) _Pragma(#TEXT)
#define SIMD PRAGMA(omp simd)
#define SIMD_REDUCTION(OPERATOR, ...) PRAGMA(omp simd reduction(OPERATOR : __VA_ARGS__))

static inline float floor_float(float p) {
#if defined(__SSE4_1__) || !defined(__x86_64__)
    return floorf(p);
#else /* SSE2 has no such instruction; beyond these limits all places are outside */
    p = p > -8388608.f ? p : -8388608.f;
    p = p < 8388608.f ? p : 8388608.f;
    const float low = (float)(int32_t)p;
    return low > p ? low - 1 : low;
#endif
}

enum { UINT8, INT8, UINT16, INT16, INT32, FLOAT32, FLOAT64, VOXEL_TYPES };
enum { NEAREST, LINEAR, CUBIC, METHODS };

/* The input, and how it is read. */
typedef struct {
    const void *samples; /* C-contiguous voxels, or coefficients of the spline in float32 or float64 */
    int64_t shape[3];
    const void *fill; /* one voxel: the value of places outside */
    int32_t voxel_type, method;
    int32_t is_far; /* places are split in float64: axes of 2^21 voxels and more, int32 and float64 voxels */
    int32_t is_straight; /* input axis a depends on the output axis a and the displacement's component of its name only */
    double matrix[9]; /* [input axis z y x][component x y z]: from displacements to input voxels */
    /* Of output axis o the place along input axis a: whole[o][a * count[o] + i] + part[o][...], both in the type of the
       arithmetic, which is float64 for int32 and float64 voxels and float32 for all others. */
    const double *whole[3], *part[3];
    int64_t count[3];
} Source;

/* A box of the output that is written: element strides along z and y; x is contiguous. */
typedef struct {
    void *values;
    int64_t stride[2];
    int64_t start[3], stop[3]; /* of the box, in voxels of the output */
} Target;

/* Displacements in space along x, y, z: at every voxel of the box, or at nodes between which they are interpolated. */
typedef struct {
    const float *d[3];
    int64_t stride[3]; /* of each component, in elements along z, y, x; nodes of a row are contiguous */
    int64_t nodes[2];  /* along z and y; 0 where every voxel has its own displacement */
    const int32_t *first[3]; /* along z, y, x the first node that each voxel of the box reads */
    const float *weights[3]; /* [tap][voxel] */
    int32_t taps[3];
} Field;

/* Displacements in a plane across the array axis `normal`: sum over k of weights[k][i along normal] * maps[k]. */
typedef struct {
    const float *maps; /* [k][u, v][row][column] of the whole output: rows and columns are the two other axes in order */
    const float *weights; /* [k][count[normal]]; NULL where one map holds everywhere */
    int64_t terms, shape[2];
    int32_t normal;
    int64_t first; /* the input's slice along the normal that is the output's first */
    double matrix[4]; /* [row, column][u, v]: from displacements to input voxels */
} PlaneField;

/* Single voxels with their displacements. */
typedef struct {
    const int32_t *voxels; /* [z, y, x][n] in the output */
    const float *d; /* [x, y, z][n] */
    void *values; /* [n] */
    int64_t count;
} VoxelList;

/* A sum over centres, or its derivatives, at the places row + column of a lattice. */
typedef struct {
    const double *row, *column;         /* [dim][rows], [dim][columns] */
    const double *center, *coefficient; /* [count][dim] */
    const double *scale;                /* [count], relative to which distances are measured; NULL where all are 1 */
    const double *linear, *constant;    /* [dim][dim], [dim] */
    const double *quadratic;            /* [dim][dim][dim] or NULL */
    void *out;                          /* [dim, or dim * dim derivatives][rows][columns] */
    int64_t rows, columns, count, first, stop; /* rows from first to stop are computed */
    int32_t dim, kernel, is_compact, is_double, derivatives;
} LatticeSum;

/* Signed distances to an outline on a picture. */
typedef struct {
    /* [edges][12]: the start, the direction, the range along it from 0 to 1, and the normals where the nearest place is
       between the ends, at the start and at the end. */
    const double *edge;
    const double *places; /* [count][2] */
    double *out;          /* [count] */
    int64_t edges, count;
} EdgeDistances;

/* All return 0, 1 where there is no memory, or 2 where a displacement is not finite. */
typedef struct {
    int (*general)(const Source *, const Field *, const Target *);
    int (*listed)(const Source *, const VoxelList *);
    int (*slices)(const Source *, const PlaneField *, const Target *);
    int (*rows)(const Source *, const PlaneField *, const Target *);
    int (*sum_lattice)(const LatticeSum *);
    int (*edge_distances)(const EdgeDistances *);
} Loops;

#endif
