/* Rows of voxels that move as a whole. Included once for each voxel type and INDEX. */

/* n rows of `length` voxels, each between four rows of the input; dr and dc lead to the next row and column of it. */
static void NAME(rows_linear)(const VOXEL *restrict samples, const INDEX *restrict index, const SHARE *restrict tr,
                              const SHARE *restrict tc, const int32_t *restrict inside, int n, INDEX dr, INDEX dc,
                              int64_t length, VOXEL fill, VOXEL *restrict out, int64_t stride) {
    for (int i = 0; i < n; i++, out += stride) {
        if (!inside[i]) {
            for (int64_t k = 0; k < length; k++) out[k] = fill;
            continue;
        }
        const SHARE s = tr[i], t = tc[i], w0 = (1 - s) * (1 - t), w1 = (1 - s) * t, w2 = s * (1 - t), w3 = s * t;
        const VOXEL *restrict a = samples + index[i], *restrict b = a + dc, *restrict c = a + dr, *restrict d = c + dc;
        SIMD for (int64_t k = 0; k < length; k++)
            out[k] = ROUND(((w0 * (SHARE)a[k] + w1 * (SHARE)b[k]) + w2 * (SHARE)c[k]) + w3 * (SHARE)d[k]);
    }
}
