/* The nearest voxels of a row. Included once for each size of voxel and INDEX. */

static void NAME(nearest)(const VOXEL *restrict samples, const INDEX *restrict index, int n, VOXEL *restrict out) {
    for (int i = 0; i < n; i++) out[i] = samples[index[i]];
}

#undef NAME
#undef VOXEL
