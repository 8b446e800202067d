/* Linear interpolation of a row of voxels at the corners of their cells. Included once for each voxel type and INDEX.

   Two neighbours along x are loaded as one word, without an instruction that gathers; words are taken apart and
   interpolated as vectors. (1 - t) a + t b gives a and b exactly at the two ends. */

#define BETWEEN(T, A, B) ((1 - (T)) * (A) + (T) * (B))

static inline PAIR NAME(pair)(const VOXEL *at) {
    PAIR two;
    memcpy(&two, at, sizeof two);
    return two;
}

/* Cells of eight corners; dz and dy lead to the next voxel along z and y. */
static void NAME(linear_8)(const VOXEL *restrict samples, const INDEX *restrict index, const SHARE *restrict tz,
                           const SHARE *restrict ty, const SHARE *restrict tx, int n, INDEX dz, INDEX dy,
                           VOXEL *restrict out) {
#ifdef FOUR
    FOUR low[ROW], high[ROW];
    for (int i = 0; i < n; i++) {
        const VOXEL *at = samples + index[i];
        low[i] = NAME(pair)(at) | (FOUR)NAME(pair)(at + dy) << 8 * sizeof(PAIR);
        high[i] = NAME(pair)(at + dz) | (FOUR)NAME(pair)(at + dz + dy) << 8 * sizeof(PAIR);
    }
    SIMD for (int i = 0; i < n; i++) {
        const SHARE x = tx[i], y = ty[i], z = tz[i];
        const FOUR l = low[i], h = high[i];
        const SHARE a = BETWEEN(y, BETWEEN(x, PART(l, 0), PART(l, 1)), BETWEEN(x, PART(l, 2), PART(l, 3)));
        const SHARE b = BETWEEN(y, BETWEEN(x, PART(h, 0), PART(h, 1)), BETWEEN(x, PART(h, 2), PART(h, 3)));
        out[i] = ROUND(BETWEEN(z, a, b));
    }
#else
    PAIR a[ROW], b[ROW], c[ROW], d[ROW];
    for (int i = 0; i < n; i++) {
        const VOXEL *at = samples + index[i];
        a[i] = NAME(pair)(at);
        b[i] = NAME(pair)(at + dy);
        c[i] = NAME(pair)(at + dz);
        d[i] = NAME(pair)(at + dz + dy);
    }
    SIMD for (int i = 0; i < n; i++) {
        const SHARE x = tx[i], y = ty[i], z = tz[i];
        const SHARE low = BETWEEN(y, BETWEEN(x, LOW(a[i]), HIGH(a[i])), BETWEEN(x, LOW(b[i]), HIGH(b[i])));
        const SHARE high = BETWEEN(y, BETWEEN(x, LOW(c[i]), HIGH(c[i])), BETWEEN(x, LOW(d[i]), HIGH(d[i])));
        out[i] = ROUND(BETWEEN(z, low, high));
    }
#endif
}

/* Cells of four corners in two rows along x. */
static void NAME(linear_4)(const VOXEL *restrict samples, const INDEX *restrict index, const SHARE *restrict ty,
                           const SHARE *restrict tx, int n, INDEX dy, VOXEL *restrict out) {
#ifdef FOUR
    FOUR word[ROW];
    for (int i = 0; i < n; i++) {
        const VOXEL *at = samples + index[i];
        word[i] = NAME(pair)(at) | (FOUR)NAME(pair)(at + dy) << 8 * sizeof(PAIR);
    }
    SIMD for (int i = 0; i < n; i++) {
        const SHARE x = tx[i];
        const FOUR w = word[i];
        out[i] = ROUND(BETWEEN(ty[i], BETWEEN(x, PART(w, 0), PART(w, 1)), BETWEEN(x, PART(w, 2), PART(w, 3))));
    }
#else
    PAIR a[ROW], b[ROW];
    for (int i = 0; i < n; i++) {
        const VOXEL *at = samples + index[i];
        a[i] = NAME(pair)(at);
        b[i] = NAME(pair)(at + dy);
    }
    SIMD for (int i = 0; i < n; i++) {
        const SHARE x = tx[i];
        out[i] = ROUND(BETWEEN(ty[i], BETWEEN(x, LOW(a[i]), HIGH(a[i])), BETWEEN(x, LOW(b[i]), HIGH(b[i]))));
    }
#endif
}

/* Cells of four corners across x. */
static void NAME(linear_across)(const VOXEL *restrict samples, const INDEX *restrict index, const SHARE *restrict tz,
                                const SHARE *restrict ty, int n, INDEX dz, INDEX dy, VOXEL *restrict out) {
    VOXEL a[ROW], b[ROW], c[ROW], d[ROW];
    for (int i = 0; i < n; i++) {
        const VOXEL *at = samples + index[i];
        a[i] = at[0];
        b[i] = at[dy];
        c[i] = at[dz];
        d[i] = at[dz + dy];
    }
    SIMD for (int i = 0; i < n; i++) {
        const SHARE y = ty[i];
        out[i] = ROUND(BETWEEN(tz[i], BETWEEN(y, (SHARE)a[i], (SHARE)b[i]), BETWEEN(y, (SHARE)c[i], (SHARE)d[i])));
    }
}

#undef BETWEEN
