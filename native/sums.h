/* Sums over centres, D(p) = constant + linear p + p quadratic p + sum_j a_j phi(|p - x_j|^2 scale_j^2), or their
   derivatives, at p = row + column. Included once for each type, REAL.

   Rows are evaluated a few columns at a time, whose sums stay in the first cache. Of a compact kernel the centres that
   reach a block of rows are listed, and of these the ones that reach the columns are added. Places are counted from
   the centre in float64 first, so that float32 has more digits next to it. */
#include "kernels.h"

typedef struct {
    REAL a[3], from[3], square; /* coefficients, place of the first column from the centre, square of the scale */
} NAME(Centre);

/* Squared relative distances of the columns. */
static inline void NAME(distances)(const NAME(Centre) *centre, REAL (*restrict column)[COLUMNS], int dim, int along, int n,
                                   REAL *restrict s) {
    if (along >= 0) {
        REAL rest = 0;
        for (int k = 0; k < dim; k++) rest += k == along ? 0 : centre->from[k] * centre->from[k];
        const REAL from = centre->from[along], square = centre->square, *restrict x = column[along];
        SIMD for (int i = 0; i < n; i++) s[i] = (rest + (from + x[i]) * (from + x[i])) * square;
        return;
    }
    const REAL *restrict x = column[0], *restrict y = column[1], *restrict z = column[2];
    const REAL x0 = centre->from[0], y0 = centre->from[1], z0 = centre->from[2];
    if (dim == 2) {
        SIMD for (int i = 0; i < n; i++) s[i] = (x0 + x[i]) * (x0 + x[i]) + (y0 + y[i]) * (y0 + y[i]);
    } else {
        SIMD for (int i = 0; i < n; i++)
            s[i] = ((x0 + x[i]) * (x0 + x[i]) + (y0 + y[i]) * (y0 + y[i])) + (z0 + z[i]) * (z0 + z[i]);
    }
    const REAL square = centre->square;
    if (square != 1) {
        SIMD for (int i = 0; i < n; i++) s[i] *= square;
    }
}

/* Two centres at a time, so that the sums are loaded half as often. */
#define KERNEL(KIND)                                                                                                   \
    static void NAME(add_##KIND)(const NAME(Centre) *c, REAL (*restrict s)[COLUMNS], int dim, int n,                   \
                                 REAL (*restrict sum)[COLUMNS]) {                                                      \
        const REAL *restrict s0 = s[0], *restrict s1 = s[1];                                                           \
        REAL *restrict x = sum[0], *restrict y = sum[1], *restrict z = sum[2];                                         \
        const REAL ax = c[0].a[0], ay = c[0].a[1], az = c[0].a[2], bx = c[1].a[0], by = c[1].a[1], bz = c[1].a[2];     \
        if (dim == 2) {                                                                                                \
            SIMD for (int i = 0; i < n; i++) {                                                                         \
                const REAL p = NAME(profile_##KIND)(s0[i]), q = NAME(profile_##KIND)(s1[i]);                           \
                x[i] += ax * p + bx * q;                                                                               \
                y[i] += ay * p + by * q;                                                                               \
            }                                                                                                          \
        } else {                                                                                                       \
            SIMD for (int i = 0; i < n; i++) {                                                                         \
                const REAL p = NAME(profile_##KIND)(s0[i]), q = NAME(profile_##KIND)(s1[i]);                           \
                x[i] += ax * p + bx * q;                                                                               \
                y[i] += ay * p + by * q;                                                                               \
                z[i] += az * p + bz * q;                                                                               \
            }                                                                                                          \
        }                                                                                                              \
    }                                                                                                                  \
    static void NAME(slopes_##KIND)(REAL square, int n, REAL *restrict s) {                                            \
        SIMD for (int i = 0; i < n; i++) s[i] = square * NAME(slope_##KIND)(s[i]);                                     \
    }
KERNELS(KERNEL)
#undef KERNEL

/* a_m slope (p - x)_k to sum m dim + k. */
static void NAME(add_derivatives)(const NAME(Centre) *c, REAL (*restrict column)[COLUMNS], const REAL *restrict slope,
                                  int dim, int n, REAL (*restrict sum)[COLUMNS]) {
    for (int k = 0; k < dim; k++) {
        const REAL from = c->from[k], *restrict x = column[k];
        for (int m = 0; m < dim; m++) {
            REAL *restrict to = sum[m * dim + k];
            const REAL a = c->a[m];
            SIMD for (int i = 0; i < n; i++) to[i] += a * (slope[i] * (from + x[i]));
        }
    }
}

/* The polynomial part at p, or its derivatives. */
static void NAME(polynomial)(const LatticeSum *job, const double *p0, REAL (*restrict column)[COLUMNS], int n,
                             REAL (*restrict sum)[COLUMNS]) {
    const int dim = job->dim;
    const double *h = job->quadratic;
    for (int m = 0; m < dim; m++)
        for (int k = 0; k < (job->derivatives ? dim : 1); k++) {
            REAL *restrict to = sum[job->derivatives ? m * dim + k : m];
            double start = job->derivatives ? job->linear[m * dim + k] : job->constant[m];
            double slope[3] = {0, 0, 0};
            for (int j = 0; j < dim; j++) {
                if (!job->derivatives) {
                    start += job->linear[m * dim + j] * p0[j];
                    slope[j] += job->linear[m * dim + j];
                    for (int l = 0; h && l < dim; l++) {
                        const double own = h[(m * dim + j) * dim + l];
                        start += own * p0[j] * p0[l];
                        slope[j] += own * p0[l];
                        slope[l] += own * p0[j];
                    }
                } else if (h) {
                    slope[j] = 2 * h[(m * dim + k) * dim + j];
                    start += slope[j] * p0[j];
                }
            }
            const REAL first = (REAL)start, a = (REAL)slope[0], b = (REAL)slope[1], c = (REAL)slope[2];
            const REAL *restrict x = column[0], *restrict y = column[1], *restrict z = column[dim - 1];
            const REAL c3 = dim > 2 ? c : 0;
            SIMD for (int i = 0; i < n; i++) to[i] = ((first + a * x[i]) + b * y[i]) + c3 * z[i];
            if (h && !job->derivatives)
                for (int j = 0; j < dim; j++)
                    for (int l = 0; l < dim; l++) {
                        const REAL own = (REAL)h[(m * dim + j) * dim + l], *restrict u = column[j],
                                   *restrict v = column[l];
                        SIMD for (int i = 0; i < n; i++) to[i] += own * u[i] * v[i];
                    }
        }
}

/* The corners of a set of lines (dim, n), from the place `from` on. */
static void NAME(corners)(const double *lines, int64_t stride, int dim, int64_t from, int64_t n, double *low, double *high) {
    for (int k = 0; k < dim; k++) {
        const double *restrict x = lines + k * stride + from;
        double a = x[0], b = x[0];
        SIMD_REDUCTION(min, a) for (int64_t i = 0; i < n; i++) a = x[i] < a ? x[i] : a;
        SIMD_REDUCTION(max, b) for (int64_t i = 0; i < n; i++) b = x[i] > b ? x[i] : b;
        low[k] = a;
        high[k] = b;
    }
}

static int NAME(sum_lattice)(const LatticeSum *job) {
    const int dim = job->dim, parts = job->derivatives ? dim * dim : dim;
    const int64_t tiles = (job->columns + COLUMNS - 1) / COLUMNS, count = job->count;
    int64_t *const near = malloc(sizeof(int64_t) * (size_t)(count + 1));
    double *const boxes = malloc(sizeof(double) * 6 * (size_t)(tiles + 1));
    REAL(*const lines)[3][COLUMNS] = malloc(sizeof(*lines) * (size_t)tiles);
    if (!near || !boxes || !lines) {
        free(near);
        free(boxes);
        free(lines);
        return 1;
    }
    double all[6];
    NAME(corners)(job->column, job->columns, dim, 0, job->columns, all, all + 3);
    int along = -1, varying = 0; /* the only component of which columns differ */
    for (int k = 0; k < dim; k++)
        if (all[3 + k] > all[k]) {
            along = k;
            varying++;
        }
    if (varying != 1) along = -1;
    for (int64_t t = 0; t < tiles; t++) {
        const int64_t c0 = t * COLUMNS, n = job->columns - c0 < COLUMNS ? job->columns - c0 : COLUMNS;
        NAME(corners)(job->column, job->columns, dim, c0, n, boxes + 6 * t, boxes + 6 * t + 3);
        for (int k = 0; k < dim; k++) {
            const double *restrict x = job->column + k * job->columns + c0;
            REAL *restrict to = lines[t][k];
            SIMD for (int64_t i = 0; i < n; i++) to[i] = (REAL)(x[i] - x[0]);
        }
    }
    for (int64_t block = job->first; block < job->stop; block += ROWS) {
        const int64_t end = block + ROWS < job->stop ? block + ROWS : job->stop;
        int64_t listed = 0;
        double low[3], high[3];
        NAME(corners)(job->row, job->rows, dim, block, end - block, low, high);
        for (int64_t j = 0; j < count; j++) {
            double gap = 0;
            if (job->is_compact) {
                const double scale = job->scale ? job->scale[j] : 1;
                for (int k = 0; k < dim; k++) {
                    const double x = job->center[j * dim + k], a = low[k] + all[k] - x, b = x - high[k] - all[3 + k];
                    const double apart = a > b ? a : b;
                    if (apart > 0) gap += apart * apart * scale * scale;
                }
            }
            if (gap < 1) near[listed++] = j;
        }
        for (int64_t r = block; r < end; r++)
            for (int64_t t = 0; t < tiles; t++) {
                const int64_t c0 = t * COLUMNS;
                const int n = (int)(job->columns - c0 < COLUMNS ? job->columns - c0 : COLUMNS);
                double p0[3];
                for (int k = 0; k < dim; k++) p0[k] = job->row[k * job->rows + r] + job->column[k * job->columns + c0];
                REAL sum[9][COLUMNS], s[2][COLUMNS];
                NAME(polynomial)(job, p0, lines[t], n, sum);
                NAME(Centre) pair[2];
                int waiting = 0;
                for (int64_t l = 0; l <= listed; l++) {
                    if (l < listed) {
                        const int64_t j = near[l];
                        const double scale = job->scale ? job->scale[j] : 1, *x = job->center + j * dim;
                        if (job->is_compact) {
                            double gap = 0;
                            for (int k = 0; k < dim; k++) {
                                const double row = job->row[k * job->rows + r] - x[k];
                                const double a = row + boxes[6 * t + k], b = -row - boxes[6 * t + 3 + k];
                                const double apart = a > b ? a : b;
                                if (apart > 0) gap += apart * apart * scale * scale;
                            }
                            if (gap >= 1) continue;
                        }
                        NAME(Centre) *own = &pair[waiting];
                        for (int k = 0; k < dim; k++) {
                            own->from[k] = (REAL)(p0[k] - x[k]);
                            own->a[k] = (REAL)job->coefficient[j * dim + k];
                        }
                        own->square = (REAL)(scale * scale);
                        NAME(distances)(own, lines[t], dim, along, n, s[waiting]);
                        waiting++;
                    } else if (waiting) { /* the last one has no partner */
                        pair[1] = pair[0];
                        pair[1].a[0] = pair[1].a[1] = pair[1].a[2] = 0;
                        memcpy(s[1], s[0], sizeof s[0]);
                        waiting = job->derivatives ? 1 : 2;
                    }
                    if (waiting == 2 || (job->derivatives && waiting)) {
                        if (job->derivatives) {
                            switch (job->kernel) {
#define KERNEL(KIND)                                                                                                   \
    case KERNEL_##KIND: NAME(slopes_##KIND)(pair[0].square, n, s[0]); break;
                                KERNELS(KERNEL)
#undef KERNEL
                            }
                            NAME(add_derivatives)(pair, lines[t], s[0], dim, n, sum);
                        } else {
                            switch (job->kernel) {
#define KERNEL(KIND)                                                                                                   \
    case KERNEL_##KIND: NAME(add_##KIND)(pair, s, dim, n, sum); break;
                                KERNELS(KERNEL)
#undef KERNEL
                            }
                        }
                        waiting = 0;
                    }
                }
                for (int m = 0; m < parts; m++)
                    memcpy((REAL *)job->out + (m * job->rows + r) * job->columns + c0, sum[m], sizeof(REAL) * (size_t)n);
            }
    }
    free(near);
    free(boxes);
    free(lines);
    return 0;
}
