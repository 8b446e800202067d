/* The same work in plain C, as fast as plain C does it: the peer of the benchmarks. One file, no intrinsics, no threads;
   each function does a range of its outermost axis. Compiled for one voxel type: VOXEL, and BYTES, its size.

   Arrays are [z][y][x]. A place more than half a voxel outside gets the fill value, any other one the value between the
   eight nearest voxels, with weights in float32; integers are rounded to the nearest, halves upwards. That is what
   deformnb computes; but compilers may join a multiplication and an addition into one operation here, so that the last
   digit of a sum, and with it a voxel whose value is half a number, may differ. Volumes are followed by 8 bytes that may
   be read. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { ROW = 256 /* voxels of a row that are done together */ };
#define SIMD _Pragma("omp simd")
#define SIMD_OR _Pragma("omp simd reduction(| : outside)")

#define ONE_BY_ONE __asm__ volatile("") /* keeps compilers from loads into lanes of vectors, which take a third longer */

#if BYTES == 1
typedef uint16_t Pair; /* two neighbours along x */
#define LOW(P) ((float)((P) & 255))
#define HIGH(P) ((float)((P) >> 8))
#define ROUND(V) ((VOXEL)(int32_t)((V) + 0.5f))
#elif BYTES == 2
typedef uint32_t Pair;
#define LOW(P) ((float)(int16_t)(P))
#define HIGH(P) ((float)(int16_t)((P) >> 16))
#define ROUND(V) ((VOXEL)(int32_t)floorf((V) + 0.5f))
#else
typedef struct {
    float low, high;
} Pair;
#define LOW(P) ((P).low)
#define HIGH(P) ((P).high)
#define ROUND(V) (V)
#endif

static inline Pair pair(const VOXEL *at) {
    Pair two;
    memcpy(&two, at, sizeof two);
    return two;
}

/* The place i + d along an axis of n voxels: its cell, and the share of the way through it. Outside [0, n - 1] the share
   leaves [0, 1]: it is below -1/2, or 3/2 and more, where the place is outside the volume. */
static inline float split(float d, float i, float last, float *cell) {
    float low = i + floorf(d);
    low = low > 0 ? low : 0;
    low = low < last ? low : last;
    *cell = low;
    return d - (low - i);
}

static inline float clip(float share) {
    share = share > 0 ? share : 0;
    return share < 1 ? share : 1;
}

static inline int is_inside(float share) { return (share >= -0.5f) & (share < 1.5f); }

/* A row of n voxels, each between rows a, b, c, d of the input. */
static inline void mix(const VOXEL *restrict a, const VOXEL *restrict b, const VOXEL *restrict c, const VOXEL *restrict d,
                       float s, float t, int n, VOXEL *restrict out) {
    const float w0 = (1 - s) * (1 - t), w1 = (1 - s) * t, w2 = s * (1 - t), w3 = s * t;
    SIMD for (int k = 0; k < n; k++) out[k] = ROUND(w0 * a[k] + w1 * b[k] + w2 * c[k] + w3 * d[k]);
}

/* One row of a replicated map: np runs of n voxels, each of which moves as a whole. */
static void move_runs(const VOXEL *restrict values, const float *restrict row, const float *restrict column, int q, int nq,
                      int np, int n, VOXEL fill, VOXEL *restrict out) {
    for (int p0 = 0; p0 < np; p0 += ROW) {
        const int count = np - p0 < ROW ? np - p0 : ROW;
        int32_t at[ROW], inside[ROW];
        float s[ROW], t[ROW];
        SIMD for (int p = 0; p < count; p++) {
            float i, j;
            const float v = split(row[p0 + p], q, nq - 2, &i), u = split(column[p0 + p], p0 + p, np - 2, &j);
            at[p] = (int32_t)i * np + (int32_t)j, s[p] = clip(v), t[p] = clip(u);
            inside[p] = is_inside(v) & is_inside(u);
        }
        for (int p = 0; p < count; p++) {
            const VOXEL *a = values + (size_t)at[p] * n, *c = a + (size_t)np * n;
            VOXEL *restrict target = out + (size_t)(p0 + p) * n;
            if (inside[p])
                mix(a, a + n, c, c + n, s[p], t[p], n, target);
            else
                for (int k = 0; k < n; k++) target[k] = fill;
        }
    }
}

/* A replicated map, with its axis last in memory. A range of rows. */
void rows(const VOXEL *restrict values, const float *restrict row, const float *restrict column, VOXEL *restrict out,
          int nq, int np, int n, VOXEL fill, int first, int stop) {
    for (int q = first; q < stop; q++) {
        const size_t at = (size_t)q * np;
        move_runs(values, row + at, column + at, q, nq, np, n, fill, out + at * n);
    }
}

#if BYTES == 1
/* The same with weights of 8 bits: less work, and up to two grey levels off. */
void rows_of_8_bits(const VOXEL *restrict values, const float *restrict row, const float *restrict column,
                    VOXEL *restrict out, int nq, int np, int n, VOXEL fill, int first, int stop) {
    for (int q = first; q < stop; q++)
        for (int p = 0; p < np; p++) {
            const size_t at = (size_t)q * np + p;
            float i, j;
            const float y = split(row[at], q, nq - 2, &i), x = split(column[at], p, np - 2, &j), s = clip(y), t = clip(x);
            VOXEL *restrict target = out + at * n;
            if (!(is_inside(y) & is_inside(x))) {
                for (int k = 0; k < n; k++) target[k] = fill;
                continue;
            }
            const uint16_t w3 = (uint16_t)(256 * s * t + 0.5f), w2 = (uint16_t)(256 * s + 0.5f) - w3,
                           w1 = (uint16_t)(256 * t + 0.5f) - w3, w0 = 256 - w1 - w2 - w3;
            const VOXEL *restrict a = values + ((size_t)i * np + (size_t)j) * n, *restrict b = a + n,
                                  *restrict c = a + (size_t)np * n, *restrict d = c + n;
            SIMD for (int k = 0; k < n; k++)
                target[k] = (uint16_t)((uint16_t)(w0 * a[k]) + (uint16_t)(w1 * b[k]) + (uint16_t)(w2 * c[k]) +
                                       (uint16_t)(w3 * d[k]) + 128) >> 8;
        }
}
#endif

/* Blocks of SIDE x SIDE voxels, each row of a block in one word, are turned by exchanging ever smaller parts of words.
   EIGHT blocks side by side are as many lanes of a vector. */
enum { SIDE = 8 / BYTES, EIGHT = 8, RUN = 32 };

static inline void exchange(uint64_t w[SIDE][EIGHT], int apart, int bits, uint64_t low) {
    for (int i = 0; i < SIDE; i++) {
        if (i & apart) continue;
        SIMD for (int l = 0; l < EIGHT; l++) {
            const uint64_t a = w[i][l], b = w[i + apart][l], change = ((a >> bits) ^ b) & low;
            w[i + apart][l] = b ^ change;
            w[i][l] = a ^ change << bits;
        }
    }
}

static inline void turn_blocks(uint64_t w[SIDE][EIGHT]) {
    exchange(w, SIDE / 2, 32, 0xffffffffu);
#if BYTES < 4
    exchange(w, SIDE / 4, 16, 0xffff0000ffffu);
#endif
#if BYTES < 2
    exchange(w, SIDE / 8, 8, 0xff00ff00ff00ffu);
#endif
}

/* Between `slices` that lie apart and runs of RUN voxels, one of each slice; whole blocks first, then the rest. */
static void to_runs(const VOXEL *slices, size_t apart, int count, int columns, VOXEL *runs) {
    int c = 0;
    for (; c + SIDE * EIGHT <= columns && count % SIDE == 0; c += SIDE * EIGHT)
        for (int k = 0; k < count; k += SIDE) {
            uint64_t w[SIDE][EIGHT];
            for (int i = 0; i < SIDE; i++) memcpy(w[i], slices + (k + i) * apart + c, sizeof w[i]);
            turn_blocks(w);
            for (int l = 0; l < EIGHT; l++)
                for (int i = 0; i < SIDE; i++) memcpy(runs + (size_t)(c + l * SIDE + i) * RUN + k, &w[i][l], 8);
        }
    for (; c < columns; c++)
        for (int k = 0; k < count; k++) runs[(size_t)c * RUN + k] = slices[k * apart + c];
}

static void to_slices(const VOXEL *runs, int count, int columns, VOXEL *slices, size_t apart) {
    int c = 0;
    for (; c + SIDE * EIGHT <= columns && count % SIDE == 0; c += SIDE * EIGHT)
        for (int k = 0; k < count; k += SIDE) {
            uint64_t w[SIDE][EIGHT];
            for (int l = 0; l < EIGHT; l++)
                for (int i = 0; i < SIDE; i++) memcpy(&w[i][l], runs + (size_t)(c + l * SIDE + i) * RUN + k, 8);
            turn_blocks(w);
            for (int i = 0; i < SIDE; i++) memcpy(slices + (k + i) * apart + c, w[i], sizeof w[i]);
        }
    for (; c < columns; c++)
        for (int k = 0; k < count; k++) slices[k * apart + c] = runs[(size_t)c * RUN + k];
}

static _Thread_local VOXEL *memory; /* kept for the next call */
static _Thread_local size_t held;

static VOXEL *scratch(size_t voxels) {
    if (voxels > held) {
        free(memory);
        memory = malloc((held = voxels) * sizeof(VOXEL));
    }
    return memory;
}

/* A replicated map, the volume as it lies: the axis of n slices that lie `apart` from each other is the first or the second
   one in memory, and rows of np voxels lie `pitch` apart. RUN slices at a time are turned to runs, moved and turned back.
   A range of blocks of RUN slices. */
void rows_in_place(const VOXEL *restrict values, const float *restrict row, const float *restrict column,
                   VOXEL *restrict out, int nq, int np, int n, VOXEL fill, int first, int stop, int64_t apart,
                   int64_t pitch) {
    VOXEL *runs = scratch(((size_t)nq + 1) * np * RUN), *moved = runs + (size_t)nq * np * RUN;
    for (int block = first; block < stop; block++) {
        const size_t start = (size_t)block * RUN * apart;
        const int count = n - block * RUN < RUN ? n - block * RUN : RUN;
        for (int q = 0; q < nq; q++) to_runs(values + start + q * pitch, apart, count, np, runs + (size_t)q * np * RUN);
        for (int q = 0; q < nq; q++) {
            const size_t at = (size_t)q * np;
            move_runs(runs, row + at, column + at, q, nq, np, RUN, fill, moved);
            to_slices(moved, count, np, out + start + q * pitch, apart);
        }
    }
}

/* A map of the plane times weights along z: nothing leaves its slice. A range of slices. */
static void modulated_row(const VOXEL *restrict slice, const float *restrict dy, const float *restrict dx, float w, int j,
                          int x0, int n, int ny, int nx, VOXEL fill, VOXEL *restrict out) {
    int32_t at[ROW], inside[ROW], outside = 0;
    float s[ROW], t[ROW];
    Pair a[ROW], b[ROW];
    SIMD_OR for (int i = 0; i < n; i++) {
        float y, x;
        const float v = split(w * dy[i], j, ny - 2, &y), u = split(w * dx[i], x0 + i, nx - 2, &x);
        at[i] = (int32_t)y * nx + (int32_t)x, s[i] = clip(v), t[i] = clip(u);
        outside |= !(inside[i] = is_inside(v) & is_inside(u));
    }
    for (int i = 0; i < n; i++) {
        a[i] = pair(slice + at[i]), b[i] = pair(slice + at[i] + nx);
        ONE_BY_ONE;
    }
    SIMD for (int i = 0; i < n; i++) {
        float p = LOW(a[i]), q = LOW(b[i]);
        p += t[i] * (HIGH(a[i]) - p), q += t[i] * (HIGH(b[i]) - q);
        out[i] = ROUND(p + s[i] * (q - p));
    }
    if (outside)
        for (int i = 0; i < n; i++) out[i] = inside[i] ? out[i] : fill;
}

void modulated(const VOXEL *restrict values, const float *restrict row, const float *restrict column,
               const float *restrict weights, VOXEL *restrict out, int ny, int nx, VOXEL fill, int first, int stop) {
    for (int k = first; k < stop; k++)
        for (int j = 0; j < ny; j++)
            for (int x0 = 0; x0 < nx; x0 += ROW) {
                const size_t at = (size_t)j * nx + x0, plane = (size_t)k * ny * nx;
                modulated_row(values + plane, row + at, column + at, weights[k], j, x0, nx - x0 < ROW ? nx - x0 : ROW, ny,
                              nx, fill, out + plane + at);
            }
}

/* Any field, its components in arrays of their own. A range of slices. */
static void general_row(const VOXEL *restrict values, const float *restrict dx, const float *restrict dy,
                        const float *restrict dz, int k, int j, int x0, int count, int nz, int ny, int nx, VOXEL fill,
                        VOXEL *restrict out) {
    int32_t at[ROW], inside[ROW], outside = 0;
    float r[ROW], s[ROW], t[ROW];
    const size_t plane = (size_t)ny * nx;
    SIMD_OR for (int i = 0; i < count; i++) {
        float z, y, x;
        const float w = split(dz[i], k, nz - 2, &z), v = split(dy[i], j, ny - 2, &y), u = split(dx[i], x0 + i, nx - 2, &x);
        at[i] = ((int32_t)z * ny + (int32_t)y) * nx + (int32_t)x;
        t[i] = clip(w), s[i] = clip(v), r[i] = clip(u);
        outside |= !(inside[i] = is_inside(w) & is_inside(v) & is_inside(u));
    }
#if BYTES == 1 /* the eight neighbours in one word */
    uint64_t word[ROW];
    for (int i = 0; i < count; i++) {
        const VOXEL *v = values + at[i], *u = v + plane;
        word[i] = (uint64_t)pair(v) | (uint64_t)pair(v + nx) << 16 | (uint64_t)pair(u) << 32 | (uint64_t)pair(u + nx) << 48;
        ONE_BY_ONE;
    }
    SIMD for (int i = 0; i < count; i++) {
        const uint32_t low = (uint32_t)word[i], high = (uint32_t)(word[i] >> 32);
        float a = low & 255, b = low >> 16 & 255, c = high & 255, d = high >> 16 & 255;
        a += r[i] * ((float)(low >> 8 & 255) - a), b += r[i] * ((float)(low >> 24) - b);
        c += r[i] * ((float)(high >> 8 & 255) - c), d += r[i] * ((float)(high >> 24) - d);
        a += s[i] * (b - a), c += s[i] * (d - c);
        out[i] = ROUND(a + t[i] * (c - a));
    }
#else
    Pair p[ROW], q[ROW], m[ROW], n[ROW];
    for (int i = 0; i < count; i++) {
        const VOXEL *v = values + at[i], *u = v + plane;
        p[i] = pair(v), q[i] = pair(v + nx), m[i] = pair(u), n[i] = pair(u + nx);
        ONE_BY_ONE;
    }
    SIMD for (int i = 0; i < count; i++) {
        float a = LOW(p[i]), b = LOW(q[i]), c = LOW(m[i]), d = LOW(n[i]);
        a += r[i] * (HIGH(p[i]) - a), b += r[i] * (HIGH(q[i]) - b);
        c += r[i] * (HIGH(m[i]) - c), d += r[i] * (HIGH(n[i]) - d);
        a += s[i] * (b - a), c += s[i] * (d - c);
        out[i] = ROUND(a + t[i] * (c - a));
    }
#endif
    if (outside)
        for (int i = 0; i < count; i++) out[i] = inside[i] ? out[i] : fill;
}

void general(const VOXEL *restrict values, const float *restrict dx, const float *restrict dy, const float *restrict dz,
             VOXEL *restrict out, int nz, int ny, int nx, VOXEL fill, int first, int stop) {
    for (int k = first; k < stop; k++)
        for (int j = 0; j < ny; j++)
            for (int x0 = 0; x0 < nx; x0 += ROW) {
                const size_t at = ((size_t)k * ny + j) * nx + x0;
                general_row(values, dx + at, dy + at, dz + at, k, j, x0, nx - x0 < ROW ? nx - x0 : ROW, nz, ny, nx, fill,
                            out + at);
            }
}

/* The sum of Wendland's C2 functions of n centres (x, y) and the trend (for both components 1, x, y) at all pixels, in
   units of the support; columns are evenly spaced. Of each row only the columns that a centre reaches. */
void sums(const float *restrict centers, const float *restrict coefficients, const float *restrict trend,
          const float *restrict rows, const float *restrict columns, float *restrict out, int n, int ny, int nx, int first,
          int stop) {
    const float step = nx > 1 ? columns[1] - columns[0] : 1;
    for (int j = first; j < stop; j++) {
        float *restrict u = out + (size_t)j * nx, *restrict v = u + (size_t)ny * nx;
        SIMD for (int i = 0; i < nx; i++) {
            u[i] = trend[0] + trend[1] * columns[i] + trend[2] * rows[j];
            v[i] = trend[3] + trend[4] * columns[i] + trend[5] * rows[j];
        }
        for (int c = 0; c < n; c++) {
            const float x = centers[2 * c], y = rows[j] - centers[2 * c + 1], far = y * y;
            if (far >= 1) continue;
            const float reach = sqrtf(1 - far), low = ceilf((x - reach - columns[0]) / step),
                        high = floorf((x + reach - columns[0]) / step);
            const int begin = low > 0 ? (int)low : 0, end = high < nx - 1 ? (int)high + 1 : nx;
            const float a = coefficients[2 * c], b = coefficients[2 * c + 1];
            SIMD for (int i = begin; i < end; i++) {
                const float r = columns[i] - x;
                float t = 1 - sqrtf(r * r + far);
                t = t > 0 ? t : 0;
                const float q = t * t, phi = q * q * (5 - 4 * t);
                u[i] += a * phi;
                v[i] += b * phi;
            }
        }
    }
}
