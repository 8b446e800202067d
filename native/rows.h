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
        const SHARE s = tr[i], t = tc[i], w1 = (1 - s) * t, w2 = s * (1 - t), w3 = s * t;
        const VOXEL *restrict a = samples + index[i], *restrict b = a + dc, *restrict c = a + dr, *restrict d = c + dc;
#ifdef WHOLE_WEIGHTS
        /* Weights in units of 2^-24, as exact as float: their sum is one, and four products with 8 bits fill 32. */
        const uint32_t one = 1u << 24, v1 = (uint32_t)(w1 * one + 0.5f), v2 = (uint32_t)(w2 * one + 0.5f),
                       v3 = (uint32_t)(w3 * one + 0.5f), v0 = one - v1 - v2 - v3;
        SIMD for (int64_t k = 0; k < length; k++)
            out[k] = (VOXEL)((v0 * a[k] + v1 * b[k] + v2 * c[k] + v3 * d[k] + one / 2) >> 24);
#else
        const SHARE w0 = (1 - s) * (1 - t);
        SIMD for (int64_t k = 0; k < length; k++)
            out[k] = ROUND(((w0 * (SHARE)a[k] + w1 * (SHARE)b[k]) + w2 * (SHARE)c[k]) + w3 * (SHARE)d[k]);
#endif
    }
}
