/* Cubic B-spline of a row of voxels, from coefficients of type SHARE, mirrored at the edges. Included once for each voxel
   type and INDEX.

   Unser, Splines: a perfect fit for signal and image processing, IEEE Signal Processing Magazine 16(6), 1999. */

static inline VOXEL NAME(rounded)(SHARE value) {
#ifdef LOWEST /* a spline leaves the range of its voxels */
    value = value > LOWEST ? value : LOWEST;
    value = value < HIGHEST ? value : HIGHEST;
#endif
    return ROUND(value);
}

/* cell, t: of each axis z, y, x; taps: 4, or 1 of an axis that is read where it is. */
static void NAME(cubic)(const SHARE *restrict samples, const INDEX (*restrict cell)[ROW],
                        const SHARE (*restrict t)[ROW], const int *taps, const int64_t *size, int n,
                        VOXEL *restrict out) {
    typedef SHARE Four __attribute__((vector_size(4 * sizeof(SHARE))));
    const INDEX stride[3] = {(INDEX)(size[1] * size[2]), (INDEX)size[2], 1};
    for (int i = 0; i < n; i++) {
        INDEX at[3][4];
        SHARE w[3][4];
        for (int a = 0; a < 3; a++) {
            const INDEX low = cell[a][i], last = (INDEX)(size[a] - 1);
            if (taps[a] == 1) {
                at[a][0] = low * stride[a];
                w[a][0] = 1;
                continue;
            }
            const SHARE s = t[a][i], r = 1 - s;
            w[a][0] = r * r * r / 6;
            w[a][1] = (SHARE)(2. / 3) - s * s * (1 - s / 2);
            w[a][2] = (SHARE)(2. / 3) - r * r * (1 + s) / 2;
            w[a][3] = s * s * s / 6;
            for (int k = 0; k < 4; k++) {
                INDEX v = low + k - 1;
                v = v < 0 ? -v : v;
                v = v > last ? 2 * last - v : v;
                at[a][k] = (v < 0 ? -v : v) * stride[a];
            }
        }
        SHARE value = 0;
        if (taps[2] == 4) {
            const int is_whole = at[2][3] - at[2][0] == 3;
            Four plane = {0, 0, 0, 0};
            for (int k = 0; k < taps[0]; k++) {
                Four row = {0, 0, 0, 0};
                for (int j = 0; j < taps[1]; j++) {
                    const SHARE *from = samples + at[0][k] + at[1][j];
                    Four some;
                    if (is_whole)
                        memcpy(&some, from + at[2][0], sizeof some);
                    else
                        some = (Four){from[at[2][0]], from[at[2][1]], from[at[2][2]], from[at[2][3]]};
                    row += w[1][j] * some;
                }
                plane += w[0][k] * row;
            }
            value = ((plane[0] * w[2][0] + plane[1] * w[2][1]) + plane[2] * w[2][2]) + plane[3] * w[2][3];
        } else {
            for (int k = 0; k < taps[0]; k++) {
                SHARE row = 0;
                for (int j = 0; j < taps[1]; j++) row += w[1][j] * samples[at[0][k] + at[1][j] + at[2][0]];
                value += w[0][k] * row;
            }
        }
        out[i] = NAME(rounded)(value);
    }
}
