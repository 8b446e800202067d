/* The best level of instructions that this processor has: 0 is what every processor of its kind has. Asked of the
   processor itself, since __builtin_cpu_supports knows nothing where zig links. */
#include "loops.h"
#include "xla_call.h"

#if defined(__x86_64__)
#include <cpuid.h>

#define BIT(K) (1u << (K))
enum { AVX_STATE = 0x06, AVX_512_STATE = 0xe6 /* registers that the operating system keeps for each thread */ };

static unsigned kept_registers(void) {
    unsigned low, high;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return low;
}
#endif

EXPORT int deformnb_best_level(void) {
#if defined(__x86_64__)
    const unsigned v2 = BIT(0) | BIT(9) | BIT(13) | BIT(19) | BIT(20) | BIT(23); /* SSE3 to SSE4.2, cmpxchg16b, popcnt */
    const unsigned v3 = BIT(12) | BIT(22) | BIT(27) | BIT(28) | BIT(29);         /* FMA, movbe, xgetbv, AVX, F16C */
    const unsigned v3_more = BIT(3) | BIT(5) | BIT(8);                           /* BMI1, AVX2, BMI2 */
    const unsigned v4 = BIT(16) | BIT(17) | BIT(28) | BIT(30) | BIT(31);         /* AVX-512 F, DQ, CD, BW, VL */
    unsigned a, b, c, d, others, lzcnt;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & v2) != v2) return 0;
    if (!__get_cpuid_count(7, 0, &a, &others, &b, &d) || !__get_cpuid(0x80000001, &a, &b, &lzcnt, &d)) return 1;
    if ((c & v3) != v3 || (others & v3_more) != v3_more || !(lzcnt & BIT(5))) return 1;
    if ((kept_registers() & AVX_STATE) != AVX_STATE) return 1;
    return (others & v4) == v4 && (kept_registers() & AVX_512_STATE) == AVX_512_STATE ? 3 : 2;
#else
    return 0;
#endif
}

/* Sizes of the structures: Python's must have the same, else it was written for another library. */
EXPORT const uint32_t deformnb_sizes[] = {
    sizeof(Source),    sizeof(Target),     sizeof(Field),         sizeof(PlaneField),
    sizeof(VoxelList), sizeof(LatticeSum), sizeof(EdgeDistances), sizeof(Loops),
};
