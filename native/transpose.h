/* Transposition of slices that lie apart into runs of one voxel of each, and back. Included once for each size of voxel.

   A tile has as many slices as a vector has lanes, and as many columns as a line of memory: each line is read and written
   at once, since slices that begin whole pages apart drive one another out of the cache. */

enum { NAME(LANES) = 16 / sizeof(VOXEL), NAME(LINE) = 64 / sizeof(VOXEL) };

typedef VOXEL NAME(Lanes) __attribute__((vector_size(16)));

/* LANES rows from `in` to LANES rows of `out`. Interleaving the first half of the rows with the second one transposes them
   when done as often as the number of rows can be halved. */
static inline void NAME(transpose_tile)(const VOXEL *in, int64_t in_stride, VOXEL *out, int64_t out_stride) {
    NAME(Lanes) a[NAME(LANES)], b[NAME(LANES)];
    for (int i = 0; i < NAME(LANES); i++) memcpy(&a[i], in + i * in_stride, 16);
    for (int half = NAME(LANES) / 2, k = NAME(LANES); k > 1; k /= 2) {
        for (int i = 0; i < half; i++) {
            b[2 * i] = INTERLEAVE_LOW(a[i], a[i + half]);
            b[2 * i + 1] = INTERLEAVE_HIGH(a[i], a[i + half]);
        }
        memcpy(a, b, sizeof a);
    }
    for (int i = 0; i < NAME(LANES); i++) memcpy(out + i * out_stride, &a[i], 16);
}

/* From slices [slice][column] to runs [column][slice]. */
static void NAME(gather_slices)(const VOXEL *in, int64_t in_stride, int64_t slices, int64_t columns, VOXEL *out,
                                int64_t out_stride) {
    int64_t k = 0;
    for (; k + NAME(LANES) <= slices; k += NAME(LANES)) {
        int64_t c = 0;
        for (; c + NAME(LINE) <= columns; c += NAME(LINE)) {
            VOXEL lines[NAME(LANES)][NAME(LINE)];
            for (int i = 0; i < NAME(LANES); i++) memcpy(lines[i], in + (k + i) * in_stride + c, 64);
            for (int j = 0; j < NAME(LINE); j += NAME(LANES))
                NAME(transpose_tile)(&lines[0][j], NAME(LINE), out + (c + j) * out_stride + k, out_stride);
        }
        for (; c < columns; c++)
            for (int i = 0; i < NAME(LANES); i++) out[c * out_stride + k + i] = in[(k + i) * in_stride + c];
    }
    for (; k < slices; k++)
        for (int64_t c = 0; c < columns; c++) out[c * out_stride + k] = in[k * in_stride + c];
}

/* From runs [column][slice] to slices [slice][column]. */
static void NAME(scatter_slices)(const VOXEL *in, int64_t in_stride, int64_t slices, int64_t columns, VOXEL *out,
                                 int64_t out_stride) {
    int64_t k = 0;
    for (; k + NAME(LANES) <= slices; k += NAME(LANES)) {
        int64_t c = 0;
        for (; c + NAME(LINE) <= columns; c += NAME(LINE)) {
            VOXEL lines[NAME(LANES)][NAME(LINE)];
            for (int j = 0; j < NAME(LINE); j += NAME(LANES))
                NAME(transpose_tile)(in + (c + j) * in_stride + k, in_stride, &lines[0][j], NAME(LINE));
            for (int i = 0; i < NAME(LANES); i++) memcpy(out + (k + i) * out_stride + c, lines[i], 64);
        }
        for (; c < columns; c++)
            for (int i = 0; i < NAME(LANES); i++) out[(k + i) * out_stride + c] = in[c * in_stride + k + i];
    }
    for (; k < slices; k++)
        for (int64_t c = 0; c < columns; c++) out[k * out_stride + c] = in[c * in_stride + k];
}

#undef NAME
#undef VOXEL
#undef INTERLEAVE_LOW
#undef INTERLEAVE_HIGH
