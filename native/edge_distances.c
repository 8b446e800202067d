/* Signed distances to outlines of straight edges. Compiled once for each level of instructions, as voxel_warp.c. */
#include "loops.h"

#include <math.h>

enum { PLACES = 256 /* whose distances stay in the first cache */ };

/* The square of the least distance, and a number with the sign of its side, after one edge more. */
static void compare(const double *edge, int n, const double *restrict x, const double *restrict y,
                    double *restrict least, double *restrict side) {
    const double sx = edge[0], sy = edge[1], ex = edge[2], ey = edge[3], low = edge[4], high = edge[5];
    const double ox = edge[6], oy = edge[7], bx = edge[8], by = edge[9], fx = edge[10], fy = edge[11];
    const double length = ex * ex + ey * ey;
    SIMD for (int i = 0; i < n; i++) {
        const double ax = x[i] - sx, ay = y[i] - sy;
        double t = (ax * ex + ay * ey) / length;
        t = t > low ? t : low;
        t = t < high ? t : high;
        const double px = ax - t * ex, py = ay - t * ey, square = px * px + py * py;
        const double nx = t <= low ? bx : t >= high ? fx : ox, ny = t <= low ? by : t >= high ? fy : oy;
        const double cx = t >= high ? ax - ex : ax, cy = t >= high ? ay - ey : ay; /* from the corner, if that is nearest */
        const double own = cx * nx + cy * ny;
        side[i] = square < least[i] ? own : side[i];
        least[i] = square < least[i] ? square : least[i];
    }
}

int PASTE(deformnb_edge_distances, LEVEL)(const EdgeDistances *job) {
    double x[PLACES], y[PLACES], least[PLACES], side[PLACES];
    for (int64_t first = 0; first < job->count; first += PLACES) {
        const int n = (int)(job->count - first < PLACES ? job->count - first : PLACES);
        const double *restrict places = job->places + 2 * first;
        for (int i = 0; i < n; i++) {
            x[i] = places[2 * i];
            y[i] = places[2 * i + 1];
            least[i] = INFINITY;
            side[i] = 0;
        }
        for (int64_t e = 0; e < job->edges; e++) compare(job->edge + 12 * e, n, x, y, least, side);
        double *restrict out = job->out + first;
        SIMD for (int i = 0; i < n; i++) {
            const double distance = sqrt(least[i]);
            out[i] = side[i] < 0 ? -distance : distance;
        }
    }
    return 0;
}
