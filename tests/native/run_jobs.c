/* Runs recorded jobs of the compiled loops: tests/native_jobs.py writes them to the standard input of this program, and
   reads from its standard output what the loops have returned and written. It is for processors on which no Python runs
   here; such have 64 bits and the order of bytes of the recording. */
#include "loops.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const Loops deformnb_loops_base;

typedef int (*Call1)(const void *);
typedef int (*Call2)(const void *, const void *);
typedef int (*Call3)(const void *, const void *, const void *);

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
        const void *address = (const char *)&deformnb_loops_base + function * sizeof(void (*)(void));
        int64_t result = -1;
        if (structures == 1) result = (*(Call1 *)address)(job[0]);
        if (structures == 2) result = (*(Call2 *)address)(job[0], job[1]);
        if (structures == 3) result = (*(Call3 *)address)(job[0], job[1], job[2]);
        fwrite(&result, sizeof result, 1, stdout);
        for (int64_t k = 0; k < arrays; k++) {
            if (is_result[k]) fwrite(array[k], 1, size[k], stdout);
            free(array[k]);
        }
        for (int64_t k = 0; k < structures; k++) free(job[k]);
    }
    return 0;
}
