/* Places of a row of voxels along one input axis: the cell in which each lies, its place in the cell, and whether it is
   inside. Included once for each type of arithmetic: REAL splits the places, SHARE holds the place in the cell, INDEX
   counts voxels of the input.

   A place is w + p: whole voxels, and the rest with the displacement. The displacement is never added to w: a float32
   place of 500 resolves 3e-5 voxels only. A place in [-1/2, n - 1/2) is inside and reads the nearest voxel of the edge.
   Comparisons are written so that a place that is no number leads to voxel 0 and outside. */

typedef struct {
    REAL w, p;               /* contribution of the planes and rows of the output */
    const REAL *whole, *part; /* of its columns; NULL for none */
    REAL m[3];
    const float *d[3]; /* displacements of the row; NULL for none */
    int64_t size;      /* of the input axis */
    INDEX stride;
} NAME(Line);

#define CELL(W, P)                                                                                                     \
    {                                                                                                                  \
        const REAL w = (W), p = (P);                                                                                   \
        REAL cell = w + FLOOR(p);                                                                                      \
        cell = cell > 0 ? cell : 0;                                                                                    \
        cell = cell < last ? cell : last;                                                                              \
        const REAL start = cell - w;                                                                                   \
        REAL s = p - start;                                                                                            \
        s = s > 0 ? s : 0;                                                                                             \
        s = s < most ? s : most;                                                                                       \
        inside[i] &= (p - start >= (REAL)-0.5) & (p - start < end);                                                    \
        index[i] += (INDEX)(int32_t)cell * stride;                                                                     \
        share[i] = (SHARE)s;                                                                                           \
    }

#define NEAREST_VOXEL(W, P)                                                                                            \
    {                                                                                                                  \
        const REAL p = (P), low = FLOOR(p), at = (W) + low + (p - low >= (REAL)0.5 ? 1 : 0);                           \
        REAL cell = at > 0 ? at : 0;                                                                                   \
        cell = cell < final ? cell : final;                                                                            \
        inside[i] &= at == cell;                                                                                       \
        index[i] += (INDEX)(int32_t)cell * stride;                                                                     \
    }

/* The kinds of lines: a row that runs along this input axis, one across it, and any. */
#define EACH_LINE(DO)                                                                                                  \
    const REAL w0 = line->w, p0 = line->p, m0 = line->m[0], m1 = line->m[1], m2 = line->m[2];                          \
    const REAL *restrict whole = line->whole, *restrict part = line->part;                                             \
    const float *restrict d0 = line->d[0], *restrict d1 = line->d[1], *restrict d2 = line->d[2];                       \
    const INDEX stride = line->stride;                                                                                 \
    if (!d0) {                                                                                                         \
        SIMD for (int i = 0; i < n; i++) DO(w0 + whole[i], p0 + part[i])                                               \
    } else if (!whole) {                                                                                               \
        if (!d1) {                                                                                                     \
            SIMD for (int i = 0; i < n; i++) DO(w0, p0 + m0 * d0[i])                                                   \
        } else {                                                                                                       \
            SIMD for (int i = 0; i < n; i++) DO(w0, p0 + ((m0 * d0[i] + m1 * d1[i]) + m2 * d2[i]))                     \
        }                                                                                                              \
    } else if (!d1) {                                                                                                  \
        SIMD for (int i = 0; i < n; i++) DO(w0 + whole[i], (p0 + part[i]) + m0 * d0[i])                                \
    } else {                                                                                                           \
        SIMD for (int i = 0; i < n; i++) DO(w0 + whole[i], (p0 + part[i]) + ((m0 * d0[i] + m1 * d1[i]) + m2 * d2[i]))  \
    }

/* Adds the offset of each voxel's cell to index. */
static void NAME(cells)(const NAME(Line) *line, int n, INDEX *restrict index, SHARE *restrict share,
                        int32_t *restrict inside) {
    const REAL last = line->size > 1 ? (REAL)(line->size - 2) : 0, most = line->size > 1 ? 1 : 0,
               end = most + (REAL)0.5;
    EACH_LINE(CELL)
}

static void NAME(nearest_voxels)(const NAME(Line) *line, int n, INDEX *restrict index, int32_t *restrict inside) {
    const REAL final = (REAL)(line->size - 1);
    EACH_LINE(NEAREST_VOXEL)
}

#undef CELL

/* The same for a row that runs along an axis of the input, whose displacements along each axis move along this one alone:
   the usual case, in one loop. */
#define CELL(LINE, W, P, TO)                                                                                           \
    {                                                                                                                  \
        const REAL w = (W), p = (P);                                                                                   \
        cell = w + FLOOR(p);                                                                                           \
        cell = cell > 0 ? cell : 0;                                                                                    \
        cell = cell < last_##LINE ? cell : last_##LINE;                                                                \
        const REAL s = p - (cell - w);                                                                                 \
        REAL t = s > 0 ? s : 0;                                                                                        \
        t = t < most_##LINE ? t : most_##LINE;                                                                         \
        over = s - t;                                                                                                  \
        TO = (SHARE)t;                                                                                                 \
    }
#define WIDEN                                                                                                          \
    low = low < over ? low : over;                                                                                     \
    high = high > over ? high : over;
#define LIMITS(LINE, OF)                                                                                               \
    const REAL last_##LINE = (OF)->size > 1 ? (REAL)((OF)->size - 2) : 0, most_##LINE = (OF)->size > 1 ? 1 : 0,        \
               m_##LINE = (OF)->m[0];                                                                                  \
    const float *restrict d_##LINE = (OF)->d[0];

static Check NAME(straight_cells)(const NAME(Line) *line, int n, INDEX *restrict index, SHARE *restrict sz,
                                  SHARE *restrict sy, SHARE *restrict sx, int32_t *restrict inside) {
    LIMITS(z, line)
    LIMITS(y, line + 1)
    LIMITS(x, line + 2)
    const REAL wz = line[0].w, pz = line[0].p, wy = line[1].w, py = line[1].p;
    const REAL *restrict whole = line[2].whole, *restrict part = line[2].part;
    const INDEX stride_z = line[0].stride, stride_y = line[1].stride;
    int32_t all = 1, finite = 1;
    SIMD_REDUCTION(&, all, finite) for (int i = 0; i < n; i++) {
        REAL cell, over;
        CELL(z, wz, pz + m_z * d_z[i], sz[i])
        INDEX at = (INDEX)(int32_t)cell * stride_z;
        REAL low = over, high = over;
        CELL(y, wy, py + m_y * d_y[i], sy[i])
        at += (INDEX)(int32_t)cell * stride_y;
        WIDEN
        CELL(x, whole[i], part[i] + m_x * d_x[i], sx[i])
        WIDEN
        index[i] = at + (INDEX)(int32_t)cell;
        inside[i] = (low >= (REAL)-0.5) & (high < (REAL)0.5);
        all &= inside[i];
        finite &= ((d_z[i] + d_y[i]) + d_x[i]) * 0.f == 0.f; /* 0 times infinity, or times no number, is no number */
    }
    return (Check){all, finite};
}

/* Within a slice that begins at `start`: y is the axis across. */
static Check NAME(slice_cells)(const NAME(Line) *across, const NAME(Line) *along, INDEX start, int n,
                               INDEX *restrict index, SHARE *restrict sy, SHARE *restrict sx,
                               int32_t *restrict inside) {
    LIMITS(y, across)
    LIMITS(x, along)
    const REAL wy = across->w, py = across->p;
    const REAL *restrict whole = along->whole, *restrict part = along->part;
    const INDEX stride = across->stride;
    int32_t all = 1;
    SIMD_REDUCTION(&, all) for (int i = 0; i < n; i++) {
        REAL cell, over;
        CELL(y, wy, py + m_y * d_y[i], sy[i])
        const INDEX at = start + (INDEX)(int32_t)cell * stride;
        REAL low = over, high = over;
        CELL(x, whole[i], part[i] + m_x * d_x[i], sx[i])
        WIDEN
        index[i] = at + (INDEX)(int32_t)cell;
        inside[i] = (low >= (REAL)-0.5) & (high < (REAL)0.5);
        all &= inside[i];
    }
    return (Check){all, 0};
}

#undef CELL
#undef WIDEN
#undef LIMITS
#undef NEAREST_VOXEL
#undef EACH_LINE
