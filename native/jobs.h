/* The four jobs, for one type of arithmetic. Included once for each. */

/* Places of a row; an axis of kind AT_ONE is read at line.w, one of kind ALONG at line.w + i. */
typedef struct {
    NAME(Line) line[3];
    int kind[3];
} NAME(RowPlaces);

/* Read n <= ROW voxels of a row. */
static Check NAME(read_row)(const Source *source, const NAME(RowPlaces) *row, int n, void *out) {
    INDEX index[3][ROW];
    SHARE share[3][ROW];
    int32_t inside[ROW];
    const int is_cubic = source->method == CUBIC, is_nearest = source->method == NEAREST;
    const INDEX stride[3] = {(INDEX)(source->shape[1] * source->shape[2]), (INDEX)source->shape[2], 1};
    const INDEX steps[3] = {source->shape[0] > 1 ? stride[0] : 0, source->shape[1] > 1 ? stride[1] : 0, 1};
    int is_simple[3]; /* between voxels, moved by one component of the displacements */
    for (int a = 0; a < 3; a++)
        is_simple[a] = row->kind[a] == BETWEEN_VOXELS && row->line[a].d[0] && !row->line[a].d[1] &&
                       !row->line[a].whole == (a < 2);
    const int is_linear = source->method == LINEAR;
    const int is_space = is_linear && is_simple[0] && is_simple[1] && is_simple[2];
    const int across = row->kind[0] == BETWEEN_VOXELS ? 0 : 1; /* if the row is read within a slice */
    const int is_slice = is_linear && row->kind[1 - across] == AT_ONE && is_simple[across] && is_simple[2];
    Check known = {1, 0};
    if (is_space) {
        NAME(RowPlaces) usual = *row;
        for (int a = 0; a < 2; a++) usual.line[a].stride = steps[a];
        known = NAME(straight_cells)(usual.line, n, index[0], share[0], share[1], share[2], inside);
    } else if (is_slice) {
        NAME(Line) line = row->line[across];
        line.stride = steps[across];
        const INDEX start = (INDEX)row->line[1 - across].w * stride[1 - across];
        known = NAME(slice_cells)(&line, row->line + 2, start, n, index[0], share[across], share[2], inside);
    } else {
        for (int i = 0; i < n; i++) inside[i] = 1;
        memset(index[0], 0, n * sizeof(INDEX));
        if (is_cubic) memset(index[1], 0, sizeof index - sizeof index[0]);
    }
    const int is_known = is_space || is_slice;
    for (int a = 0; a < 3 && !is_known; a++) {
        NAME(Line) line = row->line[a];
        INDEX *to = index[is_cubic ? a : 0];
        line.stride = is_cubic ? 1 : steps[a];
        if (row->kind[a] == AT_ONE) {
            const INDEX at = (INDEX)line.w * (is_cubic ? 1 : stride[a]);
            SIMD for (int i = 0; i < n; i++) to[i] += at;
        } else if (row->kind[a] == ALONG) {
            const INDEX at = (INDEX)line.w;
            SIMD for (int i = 0; i < n; i++) to[i] += (at + i) * line.stride;
        } else if (is_nearest) {
            NAME(nearest_voxels)(&line, n, to, inside);
        } else {
            NAME(cells)(&line, n, to, share[a], inside);
        }
    }
    const int by_z = row->kind[0] == BETWEEN_VOXELS, by_y = row->kind[1] == BETWEEN_VOXELS;
    const int by_x = row->kind[2] == BETWEEN_VOXELS && source->shape[2] > 1;
    const INDEX dz = steps[0], dy = steps[1];
    if (is_nearest) {
        switch (VOXEL_SIZES[source->voxel_type]) {
#define READ(SIZE)                                                                                                     \
    case sizeof(uint##SIZE##_t): NAME(nearest_##SIZE)(source->samples, index[0], n, out); break;
            READ(8) READ(16) READ(32) READ(64)
#undef READ
        }
    } else if (is_cubic) {
        int taps[3];
        for (int a = 0; a < 3; a++) taps[a] = row->kind[a] == BETWEEN_VOXELS && source->shape[a] > 1 ? 4 : 1;
        switch (source->voxel_type) {
#define READ(TYPE, SUFFIX)                                                                                             \
    case TYPE: NAME(cubic_##SUFFIX)(source->samples, index, share, taps, source->shape, n, out); break;
            VOXEL_CASES
#undef READ
        }
    } else {
        if (by_x && !(by_z && by_y)) {
            const int a = by_z ? 0 : 1;
            switch (source->voxel_type) {
#define READ(TYPE, SUFFIX)                                                                                             \
    case TYPE: NAME(linear_4_##SUFFIX)(source->samples, index[0], share[a], share[2], n, a ? dy : dz, out); break;
                VOXEL_CASES
#undef READ
            }
        } else if (by_x) {
            switch (source->voxel_type) {
#define READ(TYPE, SUFFIX)                                                                                             \
    case TYPE:                                                                                                         \
        NAME(linear_8_##SUFFIX)(source->samples, index[0], share[0], share[1], share[2], n, dz, dy, out);              \
        break;
                VOXEL_CASES
#undef READ
            }
        } else { /* at one voxel of x each, by z and y, or by one of them */
            for (int a = 0; a < 2; a++)
                if (!(a ? by_y : by_z)) memset(share[a], 0, sizeof share[a]);
            switch (source->voxel_type) {
#define READ(TYPE, SUFFIX)                                                                                             \
    case TYPE:                                                                                                         \
        NAME(linear_across_##SUFFIX)                                                                                   \
        (source->samples, index[0], share[0], share[1], n, by_z ? dz : 0, by_y ? dy : 0, out);                         \
        break;
                VOXEL_CASES
#undef READ
            }
        }
    }
    if (!is_known) {
        int32_t all = 1;
        SIMD_REDUCTION(&, all) for (int i = 0; i < n; i++) all &= inside[i];
        known.all_inside = all;
    }
    if (!known.all_inside) fill_outside(source, inside, n, out);
    return known;
}

/* The tables of whole and part of the output's axes, in this arithmetic. */
typedef struct {
    REAL *whole[3], *part[3];
    void *memory;
} NAME(Tables);

static int NAME(make_tables)(const Source *source, NAME(Tables) *tables) {
    int64_t total = 0;
    for (int o = 0; o < 3; o++) total += 3 * source->count[o];
    REAL *next = tables->memory = malloc(2 * (size_t)total * sizeof(REAL));
    if (!next) return 1;
    for (int o = 0; o < 3; o++) {
        const int64_t n = 3 * source->count[o];
        for (int64_t i = 0; i < n; i++) next[i] = (REAL)source->whole[o][i], next[n + i] = (REAL)source->part[o][i];
        tables->whole[o] = next;
        tables->part[o] = next + n;
        next += 2 * n;
    }
    return 0;
}

/* The lines of a row of the output: what its plane and row bring, and its columns from x on. */
static void NAME(set_row)(const Source *source, const NAME(Tables) *tables, int64_t z, int64_t y, int64_t x,
                          NAME(RowPlaces) *row) {
    const int64_t nz = source->count[0], ny = source->count[1], nx = source->count[2];
    for (int a = 0; a < 3; a++) {
        NAME(Line) *line = &row->line[a];
        row->kind[a] = BETWEEN_VOXELS;
        line->size = source->shape[a];
        line->whole = line->part = NULL;
        line->d[0] = line->d[1] = line->d[2] = NULL;
        if (!source->is_straight) {
            line->w = tables->whole[0][a * nz + z] + tables->whole[1][a * ny + y];
            line->p = tables->part[0][a * nz + z] + tables->part[1][a * ny + y];
        } else if (a < 2) {
            line->w = a ? tables->whole[1][ny + y] : tables->whole[0][z];
            line->p = a ? tables->part[1][ny + y] : tables->part[0][z];
            continue;
        } else
            line->w = line->p = 0;
        line->whole = tables->whole[2] + a * nx + x;
        line->part = tables->part[2] + a * nx + x;
    }
}

/* The displacements (x, y, z) of a row. */
static void NAME(move_row)(const Source *source, const float *const d[3], NAME(RowPlaces) *row) {
    for (int a = 0; a < 3; a++) {
        NAME(Line) *line = &row->line[a];
        const int own = 2 - a;
        for (int c = 0; c < 3; c++) {
            const int from = source->is_straight ? own : c;
            line->m[c] = (REAL)source->matrix[3 * a + from];
            line->d[c] = source->is_straight && c ? NULL : d[from];
        }
    }
}

static int NAME(general)(const Source *source, const Field *field, const Target *target) {
    const int64_t nx = target->stop[2] - target->start[2], ny = target->stop[1] - target->start[1],
                  nz = target->stop[0] - target->start[0];
    const int size = VOXEL_SIZES[source->voxel_type];
    NAME(Tables) tables;
    if (NAME(make_tables)(source, &tables)) return 1;
    const int64_t nodes_z = field->nodes[0], nodes_y = field->nodes[1], plane = nodes_y * nx;
    float *scratch = malloc(sizeof(float) * 3 * (size_t)(nx + plane * (1 + nodes_z)));
    if (!scratch) {
        free(tables.memory);
        return 1;
    }
    float *const rows = scratch, *const planes = rows + 3 * nx, *const wide = planes + 3 * plane;
    for (int c = 0; c < 3; c++)
        for (int64_t z = 0; z < nodes_z; z++)
            for (int64_t y = 0; y < nodes_y; y++)
                expand_row(field->d[c] + z * field->stride[0] + y * field->stride[1], field->first[2],
                           field->weights[2], field->taps[2], nx, wide + ((c * nodes_z + z) * nodes_y + y) * nx);
    int result = 0;
    for (int64_t z = 0; z < nz; z++) {
        for (int c = 0; c < 3 && nodes_y; c++)
            mix_rows(wide + (c * nodes_z + field->first[0][z]) * plane, plane, field->weights[0] + z, nz,
                     field->taps[0], plane, planes + c * plane);
        for (int64_t y = 0; y < ny; y++) {
            const float *d[3] = {rows, rows + nx, rows + 2 * nx};
            const int64_t at = z * field->stride[0] + y * field->stride[1];
            if (nodes_y)
                for (int c = 0; c < 3; c++)
                    mix_rows(planes + c * plane + field->first[1][y] * nx, nx, field->weights[1] + y, ny,
                             field->taps[1], nx, rows + c * nx);
            else if (field->stride[2] == 1)
                for (int c = 0; c < 3; c++) d[c] = field->d[c] + at;
            else if (field->stride[2] == 3 && field->d[1] == field->d[0] + 1 && field->d[2] == field->d[0] + 2)
                split_row(field->d[0] + at, nx, rows);
            else
                for (int c = 0; c < 3; c++)
                    for (int64_t i = 0; i < nx; i++) rows[c * nx + i] = field->d[c][at + i * field->stride[2]];
            int all_finite = 1;
            NAME(RowPlaces) row;
            char *out = (char *)target->values + size * (z * target->stride[0] + y * target->stride[1]);
            for (int64_t x = 0; x < nx; x += ROW) {
                const float *const part[3] = {d[0] + x, d[1] + x, d[2] + x};
                NAME(set_row)(source, &tables, target->start[0] + z, target->start[1] + y, target->start[2] + x, &row);
                NAME(move_row)(source, part, &row);
                const Check known =
                    NAME(read_row)(source, &row, (int)(nx - x < ROW ? nx - x : ROW), out + size * x);
                all_finite &= known.all_finite | known.all_inside; /* what is not finite leads outside */
            }
            if (!all_finite && !is_finite(d, nx)) result = 2;
        }
    }
    free(scratch);
    free(tables.memory);
    return result;
}

static int NAME(listed)(const Source *source, const VoxelList *voxels) {
    const int size = VOXEL_SIZES[source->voxel_type];
    NAME(Tables) tables;
    if (NAME(make_tables)(source, &tables)) return 1;
    REAL places[6][ROW];
    NAME(RowPlaces) row;
    for (int64_t first = 0; first < voxels->count; first += ROW) {
        const int n = (int)(voxels->count - first < ROW ? voxels->count - first : ROW);
        for (int a = 0; a < 3; a++) {
            for (int i = 0; i < n; i++) {
                REAL w = 0, p = 0;
                for (int o = 0; o < 3; o++) {
                    const int64_t at = a * source->count[o] + voxels->voxels[o * voxels->count + first + i];
                    w += tables.whole[o][at];
                    p += tables.part[o][at];
                }
                places[a][i] = w;
                places[3 + a][i] = p;
            }
            row.kind[a] = BETWEEN_VOXELS;
            row.line[a] = (NAME(Line)){.whole = places[a], .part = places[3 + a], .size = source->shape[a]};
        }
        const float *const d[3] = {voxels->d + first, voxels->d + voxels->count + first,
                                   voxels->d + 2 * voxels->count + first};
        NAME(move_row)(source, d, &row);
        NAME(read_row)(source, &row, n, (char *)voxels->values + size * first);
    }
    free(tables.memory);
    return 0;
}

/* Displacements along u and v of n pixels from a place on, as mapped at one slice. */
static void NAME(sum_maps)(const PlaneField *field, int64_t slice, int64_t slices, int64_t pixel, int64_t n,
                           float *restrict du, float *restrict dv) {
    const int64_t size = field->shape[0] * field->shape[1];
    for (int64_t k = 0; k < field->terms; k++) {
        const float w = field->weights ? field->weights[k * slices + slice] : 1;
        const float *restrict u = field->maps + 2 * k * size + pixel, *restrict v = u + size;
        if (k) {
            SIMD for (int64_t i = 0; i < n; i++) du[i] += w * u[i], dv[i] += w * v[i];
        } else {
            SIMD for (int64_t i = 0; i < n; i++) du[i] = w * u[i], dv[i] = w * v[i];
        }
    }
}

/* Displacements along u and v, of which one does not count where axes are parallel. */
static void NAME(move_line)(NAME(Line) *line, const double matrix[2], const float *u, const float *v) {
    const int only_v = matrix[0] == 0, both = matrix[0] != 0 && matrix[1] != 0;
    line->m[0] = (REAL)matrix[only_v];
    line->m[1] = (REAL)matrix[1];
    line->m[2] = 0;
    line->d[0] = only_v ? v : u;
    line->d[1] = line->d[2] = both ? v : NULL;
}

/* Rows whose displacements change along the normal. */
static int NAME(slices)(const Source *source, const PlaneField *field, const Target *target) {
    const int size = VOXEL_SIZES[source->voxel_type], normal = field->normal;
    const int64_t nx = target->stop[2] - target->start[2], slices = source->count[normal];
    const int axes[2] = {normal == 0 ? 1 : 0, normal == 2 ? 1 : 2}; /* of rows and columns of the maps */
    NAME(Tables) tables;
    if (NAME(make_tables)(source, &tables)) return 1;
    float *u = malloc(2 * (size_t)nx * sizeof(float)), *v = u + nx;
    if (!u) {
        free(tables.memory);
        return 1;
    }
    NAME(RowPlaces) row;
    for (int64_t z = target->start[0]; z < target->stop[0]; z++)
        for (int64_t y = target->start[1]; y < target->stop[1]; y++) {
            if (normal == 2) {
                const int64_t pixel = z * field->shape[1] + y, all = field->shape[0] * field->shape[1];
                for (int64_t k = 0; k < field->terms; k++) {
                    const float du = field->maps[2 * k * all + pixel], dv = field->maps[(2 * k + 1) * all + pixel];
                    const float *restrict w = field->weights + k * slices + target->start[2];
                    if (k) {
                        SIMD for (int64_t i = 0; i < nx; i++) u[i] += w[i] * du, v[i] += w[i] * dv;
                    } else {
                        SIMD for (int64_t i = 0; i < nx; i++) u[i] = w[i] * du, v[i] = w[i] * dv;
                    }
                }
            } else {
                NAME(sum_maps)(field, normal ? y : z, slices, (normal ? z : y) * field->shape[1] + target->start[2],
                               nx, u, v);
            }
            char *out = (char *)target->values + size * ((z - target->start[0]) * target->stride[0] +
                                                         (y - target->start[1]) * target->stride[1]);
            for (int64_t x = 0; x < nx; x += ROW) {
                const int n = (int)(nx - x < ROW ? nx - x : ROW);
                const int64_t at[3] = {z, y, target->start[2] + x};
                for (int a = 0; a < 3; a++) {
                    NAME(Line) *line = &row.line[a];
                    *line = (NAME(Line)){.size = source->shape[a]};
                    row.kind[a] = a == normal ? a == 2 ? ALONG : AT_ONE : BETWEEN_VOXELS;
                    if (a == normal) {
                        line->w = (REAL)(field->first + at[a]);
                        continue;
                    }
                    const int r = a == axes[1];
                    for (int j = 0; j < 2; j++) {
                        const int o = axes[j];
                        if (source->is_straight && o != a) continue; /* where all is 0 */
                        const REAL *whole = tables.whole[o] + a * source->count[o] + at[o],
                                   *part = tables.part[o] + a * source->count[o] + at[o];
                        if (o == 2)
                            line->whole = whole, line->part = part;
                        else
                            line->w += *whole, line->p += *part;
                    }
                    NAME(move_line)(line, field->matrix + 2 * r, u + x, v + x);
                }
                NAME(read_row)(source, &row, n, out + size * x);
            }
        }
    free(u);
    free(tables.memory);
    return 0;
}

/* Rows of the output that show whole rows of an input: where they are read. */
typedef struct {
    INDEX index[3][ROW]; /* the first of the four corners; or the cells along rows and columns, for a spline */
    SHARE share[2][ROW];
    int32_t inside[ROW];
} NAME(RowTaps);

/* The taps of n pixels of row r from column c on. */
static void NAME(find_taps)(const Source *source, const PlaneField *field, const NAME(Tables) *tables, int64_t r,
                            int64_t c, int n, const INDEX stride[2], NAME(RowTaps) *taps) {
    const int axes[2] = {field->normal == 0 ? 1 : 0, field->normal == 2 ? 1 : 2};
    const int64_t size = field->shape[0] * field->shape[1], pixel = r * field->shape[1] + c;
    for (int i = 0; i < n; i++) taps->inside[i] = 1;
    memset(taps->index, 0, sizeof taps->index);
    for (int j = 0; j < 2; j++) {
        const int a = axes[j];
        const int64_t rows = source->count[axes[0]], columns = source->count[axes[1]];
        NAME(Line) line = {.size = source->shape[a]};
        line.w = tables->whole[axes[0]][a * rows + r];
        line.p = tables->part[axes[0]][a * rows + r];
        line.whole = tables->whole[axes[1]] + a * columns + c;
        line.part = tables->part[axes[1]] + a * columns + c;
        NAME(move_line)(&line, field->matrix + 2 * j, field->maps + pixel, field->maps + size + pixel);
        line.stride = source->method == CUBIC ? 1 : stride[j];
        if (source->method == NEAREST)
            NAME(nearest_voxels)(&line, n, taps->index[0], taps->inside);
        else
            NAME(cells)(&line, n, taps->index[source->method == CUBIC ? j : 0], taps->share[j], taps->inside);
    }
}

/* Rows of `length` voxels by taps. */
static void NAME(move_rows)(const Source *source, const void *samples, const NAME(RowTaps) *taps, int n,
                            const INDEX stride[2], int64_t length, void *out, int64_t out_stride) {
    const int size = VOXEL_SIZES[source->voxel_type];
    if (source->method == NEAREST) {
        for (int i = 0; i < n; i++) {
            char *to = (char *)out + size * i * out_stride;
            if (taps->inside[i])
                memcpy(to, (const char *)samples + (size_t)size * taps->index[0][i], size * (size_t)length);
            else
                fill_row(source, length, to);
        }
        return;
    }
    switch (source->voxel_type) {
#define READ(TYPE, SUFFIX)                                                                                             \
    case TYPE:                                                                                                         \
        NAME(rows_linear_##SUFFIX)                                                                                     \
        (samples, taps->index[0], taps->share[0], taps->share[1], taps->inside, n, stride[0], stride[1], length,       \
         *(const NAME(Voxel_##SUFFIX) *)source->fill, out, out_stride);                                                \
        break;
        VOXEL_CASES
#undef READ
    }
}

/* One map for all slices: rows along the normal move as a whole. Slices along another axis are transposed, a few at a
   time. Not for splines. */
static int NAME(rows)(const Source *source, const PlaneField *field, const Target *target) {
    const int size = VOXEL_SIZES[source->voxel_type], normal = field->normal;
    const int axes[2] = {normal == 0 ? 1 : 0, normal == 2 ? 1 : 2};
    const int64_t r0 = target->start[axes[0]], r1 = target->stop[axes[0]], c0 = target->start[axes[1]],
                  c1 = target->stop[axes[1]], length = target->stop[normal] - target->start[normal],
                  first = field->first + target->start[normal];
    const int64_t steps[3] = {source->shape[1] * source->shape[2], source->shape[2], 1};
    const int64_t to[3] = {target->stride[0], target->stride[1], 1};
    NAME(Tables) tables;
    if (NAME(make_tables)(source, &tables)) return 1;
    NAME(RowTaps) taps;
    if (normal == 2) { /* an axis of one voxel has no next one, which would be read with a weight of zero */
        const INDEX stride[2] = {source->shape[0] > 1 ? (INDEX)steps[0] : 0, source->shape[1] > 1 ? (INDEX)steps[1] : 0};
        const char *samples = (const char *)source->samples + size * first;
        for (int64_t r = r0; r < r1; r++)
            for (int64_t c = c0; c < c1; c += ROW) {
                const int n = (int)(c1 - c < ROW ? c1 - c : ROW);
                NAME(find_taps)(source, field, &tables, r, c, n, stride, &taps);
                NAME(move_rows)(source, samples, &taps, n, stride, length,
                                (char *)target->values + size * ((r - r0) * to[0] + (c - c0) * to[1]), to[1]);
            }
        free(tables.memory);
        return 0;
    }
    const int64_t rows = source->shape[axes[0]], columns = source->shape[2], run = length < RUN ? length : RUN;
    const INDEX stride[2] = {rows > 1 ? (INDEX)(columns * run) : 0, columns > 1 ? (INDEX)run : 0};
    char *const table = malloc((size_t)(rows * columns * run + ROW * run) * size);
    if (!table) {
        free(tables.memory);
        return 1;
    }
    char *const runs = table + rows * columns * run * size;
    for (int64_t k = 0; k < length; k += run) {
        const int64_t count = length - k < run ? length - k : run;
        for (int64_t r = 0; r < rows; r++)
            gather_slices(size, (const char *)source->samples + size * ((first + k) * steps[normal] + r * steps[axes[0]]),
                          steps[normal], count, columns, table + size * r * columns * run, run);
        for (int64_t r = r0; r < r1; r++)
            for (int64_t c = c0; c < c1; c += ROW) {
                const int n = (int)(c1 - c < ROW ? c1 - c : ROW);
                NAME(find_taps)(source, field, &tables, r, c, n, stride, &taps);
                NAME(move_rows)(source, table, &taps, n, stride, count, runs, run);
                scatter_slices(size, runs, run, count, n,
                               (char *)target->values +
                                   size * (k * to[normal] + (r - r0) * to[axes[0]] + (c - c0)), to[normal]);
            }
    }
    free(table);
    free(tables.memory);
    return 0;
}
