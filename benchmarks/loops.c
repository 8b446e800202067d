/* Plain loops in C: the arithmetic of loops.py, a row at a time. VOXEL is the type of voxels, HALF what is
   added before they are cut off. Arrays are [z][y][x]; places more than half a voxel outside get the fill value. */
#include <math.h>
#include <stdint.h>
#include <stddef.h>

#define LONGEST 4096  /* voxels of a row */

static inline int cell(float place, int n, float *fraction) {
    place = place < 0 ? 0 : place > n - 1 ? n - 1 : place;
    int low = (int)place;
    low = low > n - 2 ? n - 2 : low;
    *fraction = place - low;
    return low;
}

static inline int is_inside(float place, int n) { return (place >= -0.5f) & (place < n - 0.5f); }

/* A replicated map: rows of n voxels move as a whole. */
void rows(const VOXEL *restrict values, const float *restrict row, const float *restrict column, VOXEL *restrict out,
          int nq, int np, int n, float fill) {
    #pragma omp parallel for schedule(dynamic, 4)
    for (int q = 0; q < nq; q++)
        for (int p = 0; p < np; p++) {
            size_t at = (size_t)q * np + p;
            float y = q + row[at], x = p + column[at], s, t;
            VOXEL *restrict target = out + at * n;
            if (!(is_inside(y, nq) & is_inside(x, np))) {
                for (int k = 0; k < n; k++) target[k] = (VOXEL)fill;
                continue;
            }
            int i = cell(y, nq, &s), j = cell(x, np, &t);
            float d = s * t, c = s - d, b = t - d, a = 1 - s - b;
            const VOXEL *v00 = values + ((size_t)i * np + j) * n, *v01 = v00 + n, *v10 = v00 + (size_t)np * n, *v11 = v10 + n;
            #pragma omp simd
            for (int k = 0; k < n; k++) target[k] = (VOXEL)(int)(a * v00[k] + b * v01[k] + c * v10[k] + d * v11[k] + HALF);
        }
}

/* A map times weights along z: nothing leaves its slice. */
void modulated(const VOXEL *restrict values, const float *restrict row, const float *restrict column,
               const float *restrict weights, VOXEL *restrict out, int nz, int ny, int nx, float fill) {
    #pragma omp parallel for schedule(dynamic, 4)
    for (int k = 0; k < nz; k++) {
        const VOXEL *slice = values + (size_t)k * ny * nx;
        for (int j = 0; j < ny; j++) {
            int at[LONGEST], ok[LONGEST];
            float across[LONGEST], along[LONGEST];
            #pragma omp simd
            for (int i = 0; i < nx; i++) {
                float y = j + weights[k] * row[j * nx + i], x = i + weights[k] * column[j * nx + i];
                int low = cell(y, ny, across + i);
                at[i] = low * nx + cell(x, nx, along + i);
                ok[i] = is_inside(y, ny) & is_inside(x, nx);
            }
            VOXEL *restrict target = out + ((size_t)k * ny + j) * nx;
            #pragma omp simd
            for (int i = 0; i < nx; i++) {
                const VOXEL *v = slice + at[i];
                float a = v[0] + along[i] * (v[1] - v[0]), b = v[nx] + along[i] * (v[nx + 1] - v[nx]);
                target[i] = ok[i] ? (VOXEL)(a + across[i] * (b - a) + HALF) : (VOXEL)fill;
            }
        }
    }
}

/* Any field, displacements x, y, z of every voxel one after the other. */
void general(const VOXEL *restrict values, const float *restrict displacement, VOXEL *restrict out, int nz, int ny, int nx,
             float fill) {
    const size_t plane = (size_t)ny * nx;
    #pragma omp parallel for schedule(dynamic, 4)
    for (int k = 0; k < nz; k++)
        for (int j = 0; j < ny; j++) {
            int ok[LONGEST];
            int64_t at[LONGEST];
            float r[LONGEST], s[LONGEST], t[LONGEST];
            size_t first = k * plane + (size_t)j * nx;
            #pragma omp simd
            for (int i = 0; i < nx; i++) {
                const float *d = displacement + 3 * (first + i);
                float x = i + d[0], y = j + d[1], z = k + d[2];
                int c = cell(z, nz, t + i), b = cell(y, ny, s + i), a = cell(x, nx, r + i);
                at[i] = ((int64_t)c * ny + b) * nx + a;
                ok[i] = is_inside(z, nz) & is_inside(y, ny) & is_inside(x, nx);
            }
            VOXEL *restrict target = out + first;
            #pragma omp simd
            for (int i = 0; i < nx; i++) {
                const VOXEL *v = values + at[i], *w = v + plane;
                float a = v[0] + r[i] * (v[1] - v[0]), b = v[nx] + r[i] * (v[nx + 1] - v[nx]);
                float c = w[0] + r[i] * (w[1] - w[0]), d = w[nx] + r[i] * (w[nx + 1] - w[nx]);
                a += s[i] * (b - a), c += s[i] * (d - c);
                target[i] = ok[i] ? (VOXEL)(a + t[i] * (c - a) + HALF) : (VOXEL)fill;
            }
        }
}

/* The sum of Wendland's C2 functions of n centres (x, y) and the trend (for both components 1, x, y) at all pixels. */
void sums(const float *restrict centers, const float *restrict coefficients, const float *restrict trend,
          const float *restrict rows, const float *restrict columns, float *restrict out, int n, int ny, int nx) {
    #pragma omp parallel for schedule(dynamic, 4)
    for (int j = 0; j < ny; j++) {
        float *restrict u = out + (size_t)j * nx, *restrict v = u + (size_t)ny * nx;
        for (int i = 0; i < nx; i++) {
            u[i] = trend[0] + trend[1] * columns[i] + trend[2] * rows[j];
            v[i] = trend[3] + trend[4] * columns[i] + trend[5] * rows[j];
        }
        for (int c = 0; c < n; c++) {
            float x = centers[2 * c], y = rows[j] - centers[2 * c + 1], a = coefficients[2 * c], b = coefficients[2 * c + 1];
            if (y * y >= 1) continue;
            #pragma omp simd
            for (int i = 0; i < nx; i++) {
                float r = columns[i] - x, t = 1 - sqrtf(r * r + y * y);
                t = t > 0 ? t : 0;
                float q = t * t, phi = q * q * (5 - 4 * t);
                u[i] += a * phi;
                v[i] += b * phi;
            }
        }
    }
}
