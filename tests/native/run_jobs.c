/* Runs recorded jobs of the compiled loops: tests/native_jobs.py writes them to the standard input of this program, and
   reads from its standard output what the loops have returned and written. It is for processors on which no Python runs
   here; such have 64 bits and the order of bytes of the recording. */
#include "loops.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const Loops deformnb_loops_base;

enum { MOST_STRUCTURES = 3, MOST_ARRAYS = 64 };

static void get(void *to, size_t bytes) {
    if (fread(to, 1, bytes, stdin) != bytes) exit(3);
}

static int64_t get_number(void) {
    int64_t value;
    get(&value, sizeof value);
    return value;
}

static void *get_bytes(int64_t bytes) {
    void *to = malloc(bytes ? bytes : 1);
    if (!to) exit(4);
    get(to, bytes);
    return to;
}

int main(void) {
    int64_t function;
    const Loops *loops = &deformnb_loops_base;
    while (fread(&function, 1, sizeof function, stdin) == sizeof function) {
        char *job[MOST_STRUCTURES];
        char *array[MOST_ARRAYS];
        int64_t size[MOST_ARRAYS], is_result[MOST_ARRAYS];
        const int64_t structures = get_number(), arrays = get_number();
        if (structures > MOST_STRUCTURES || arrays > MOST_ARRAYS) return 5;
        for (int64_t k = 0; k < structures; k++) job[k] = get_bytes(get_number());
        for (int64_t k = 0; k < arrays; k++) {
            const int64_t structure = get_number(), offset = get_number();
            is_result[k] = get_number();
            size[k] = get_number();
            array[k] = get_bytes(size[k]);
            memcpy(job[structure] + offset, &array[k], sizeof array[k]);
        }
        const void *a = job[0], *b = structures > 1 ? job[1] : 0, *c = structures > 2 ? job[2] : 0;
        int64_t result = -1;
        switch (function) {
        case 0: result = loops->general(a, b, c); break;
        case 1: result = loops->listed(a, b); break;
        case 2: result = loops->slices(a, b, c); break;
        case 3: result = loops->rows(a, b, c); break;
        case 4: result = loops->sum_lattice(a); break;
        case 5: result = loops->edge_distances(a); break;
        }
        fwrite(&result, sizeof result, 1, stdout);
        for (int64_t k = 0; k < arrays; k++) {
            if (is_result[k]) fwrite(array[k], 1, size[k], stdout);
            free(array[k]);
        }
        for (int64_t k = 0; k < structures; k++) free(job[k]);
    }
    return 0;
}
