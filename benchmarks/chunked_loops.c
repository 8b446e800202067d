// Warps of n^3 bytes in plain C, without files: how much two processes gain over one on this machine.
// loops KIND N ROUNDS, with KIND "replicated" (rows along z move together) or "general" (displacements at every 16th
// voxel, linear in between). Prints a voxel, so that no compiler leaves the loops out.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static inline int cell(float *place, int n) {
  float s = fminf(fmaxf(*place, 0), n - 1);
  int i = (int)s;
  if (i > n - 2) i = n - 2;
  *place = s - i;
  return i;
}

// Eight-bit weights that sum to 256; D (n, n, 2) in voxels.
static void replicated(const uint8_t *restrict v, const float *restrict D, uint8_t *restrict o, int n) {
  for (int x = 0; x < n; x++)
    for (int y = 0; y < n; y++) {
      size_t p = (size_t)x * n + y;
      float fx = x + D[2 * p], fy = y + D[2 * p + 1];
      int i = cell(&fx, n), j = cell(&fy, n);
      uint16_t w11 = (uint16_t)(256 * fx * fy + .5f), w10 = (uint16_t)(256 * fx + .5f) - w11;
      uint16_t w01 = (uint16_t)(256 * fy + .5f) - w11, w00 = 256 - w11 - w10 - w01;
      const uint8_t *a = v + ((size_t)i * n + j) * n, *b = a + n, *c = a + (size_t)n * n, *d = c + n;
      uint8_t *q = o + p * n;
      for (int z = 0; z < n; z++)
        q[z] = (uint16_t)((uint16_t)(w00 * a[z]) + (uint16_t)(w01 * b[z]) + (uint16_t)(w10 * c[z]) +
                          (uint16_t)(w11 * d[z]) + 128) >> 8;
    }
}

// Displacements G (m, m, m, 3) at every k-th voxel: interpolated for a row of voxels, then looked up.
static void general(const uint8_t *restrict v, const float *restrict G, uint8_t *restrict o, int n, int m, int k) {
  float *row = malloc(3 * m * sizeof *row);
  for (int x = 0; x < n; x++)
    for (int y = 0; y < n; y++) {
      int i = x / k, j = y / k;
      float a = (float)(x % k) / k, b = (float)(y % k) / k;
      const float *p = G + ((size_t)i * m + j) * m * 3, *q = p + m * 3, *r = p + (size_t)m * m * 3, *s = r + m * 3;
      for (int c = 0; c < 3 * m; c++) row[c] = (1 - a) * ((1 - b) * p[c] + b * q[c]) + a * ((1 - b) * r[c] + b * s[c]);
      for (int z = 0; z < n; z++) {
        int l = z / k;
        float t = (float)(z % k) / k, f[3];
        for (int c = 0; c < 3; c++) f[c] = (1 - t) * row[3 * l + c] + t * row[3 * l + 3 + c];
        f[0] += x, f[1] += y, f[2] += z;
        int u = cell(f, n), w = cell(f + 1, n), h = cell(f + 2, n);
        const uint8_t *e = v + ((size_t)u * n + w) * n + h, *g = e + (size_t)n * n;
        float low = (1 - f[1]) * ((1 - f[2]) * e[0] + f[2] * e[1]) + f[1] * ((1 - f[2]) * e[n] + f[2] * e[n + 1]);
        float high = (1 - f[1]) * ((1 - f[2]) * g[0] + f[2] * g[1]) + f[1] * ((1 - f[2]) * g[n] + f[2] * g[n + 1]);
        o[((size_t)x * n + y) * n + z] = (uint8_t)((1 - f[0]) * low + f[0] * high + .5f);
      }
    }
  free(row);
}

int main(int count, char **words) {
  if (count != 4) return 2;
  int n = atoi(words[2]), rounds = atoi(words[3]), k = 16, m = n / k + 2, flat = !strcmp(words[1], "replicated");
  size_t voxels = (size_t)n * n * n, numbers = flat ? (size_t)2 * n * n : (size_t)3 * m * m * m;
  uint8_t *v = malloc(voxels), *o = malloc(voxels);
  float *D = malloc(numbers * sizeof *D);
  if (!v || !o || !D) return 1;
  for (size_t p = 0; p < voxels; p++) v[p] = (uint8_t)(p * 2654435761u >> 24);
  for (size_t p = 0; p < numbers; p++) D[p] = n / 40.f * sinf(p * .001f);
  for (int r = 0; r < rounds; r++) {
    if (flat) replicated(v, D, o, n);
    else general(v, D, o, n, m, k);
    v[0] = o[voxels / 2];
  }
  printf("%d\n", o[voxels / 2]);
  return 0;
}
