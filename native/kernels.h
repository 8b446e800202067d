/* Radial functions of the squared relative distance s, and twice their derivatives by s; deformnb/rbf/kernels.py has their
   names and sources. Included once for each type, REAL, with its SQRT. */

static inline REAL NAME(positive)(REAL t) { return t > 0 ? t : 0; }

/* log(s) = k log 2 + 2 atanh((m - 1) / (m + 1)) with s = 2^k m and m next to 1; as in deformnb/rbf/kernels.py. */
static inline REAL NAME(logarithm)(REAL s) {
    BITS bits;
    memcpy(&bits, &s, sizeof bits);
    const BITS exponent = (bits + (((BITS)BIAS << WIDTH) - ROOT_HALF)) >> WIDTH;
    const BITS whole = exponent | TWO_TO_WIDTH, rest = bits - ((exponent - BIAS) << WIDTH);
    REAL k, m;
    memcpy(&k, &whole, sizeof k);
    memcpy(&m, &rest, sizeof m);
    k -= TWO_TO_WIDTH_AND_BIAS;
    const REAL f = (m - 1) / (m + 1), z = f * f;
    return k * LOG_2_HIGH + (2 * f + (2 * f * z * LOG_SERIES(z) + k * LOG_2_LOW));
}

/* exp(x) of x <= 0 = 2^k exp(r), |r| <= log(2) / 2, by Taylor's series. */
static inline REAL NAME(exponential)(REAL x) {
    x = x > LEAST_EXPONENT ? x : LEAST_EXPONENT;
    const REAL k = FLOOR(x * (REAL)1.4426950408889634 + (REAL)0.5);
    const REAL r = (x - k * LOG_2_HIGH) - k * LOG_2_LOW;
    REAL sum = 1;
    for (int i = EXP_TERMS; i > 0; i--) sum = 1 + sum * r * (1 / (REAL)i);
    const BITS bits = (BITS)((int32_t)k + BIAS) << WIDTH;
    REAL scale;
    memcpy(&scale, &bits, sizeof scale);
    return sum * scale;
}

#define TINY ((REAL)1e-30)
#define AWAY(S) ((S) > TINY ? (S) : TINY)

#define KERNEL(KIND, PROFILE, SLOPE)                                                                                   \
    static inline REAL NAME(profile_##KIND)(REAL s) { return PROFILE; }                                                \
    static inline REAL NAME(slope_##KIND)(REAL s) { return SLOPE; }

static inline REAL NAME(c2)(REAL t) { return (t * t) * (t * t) * (5 - 4 * t); }
static inline REAL NAME(c4)(REAL s, REAL r, REAL t) {
    return (t * t) * (t * t) * (t * t) * (35 * s + 18 * r + 3) * (REAL)(1. / 3);
}
static inline REAL NAME(power)(REAL t, int n) {
    REAL product = t;
    for (int i = 1; i < n; i++) product *= t;
    return product;
}

KERNEL(wendland_c0, NAME(power)(NAME(positive)(1 - SQRT(s)), 2), -2 * NAME(positive)(1 - SQRT(AWAY(s))) / SQRT(AWAY(s)))
KERNEL(wendland_c2, NAME(c2)(NAME(positive)(1 - SQRT(s))), -20 * NAME(power)(NAME(positive)(1 - SQRT(s)), 3))
KERNEL(wendland_c4, NAME(c4)(s, SQRT(s), NAME(positive)(1 - SQRT(s))),
       (REAL)(-56. / 3) * (1 + 5 * SQRT(s)) * NAME(power)(NAME(positive)(1 - SQRT(s)), 5))
KERNEL(gaussian, NAME(exponential)(-(REAL)4.5 * s), -9 * NAME(exponential)(-(REAL)4.5 * s))
KERNEL(multiquadric, -SQRT(1 + 16 * s), -16 / SQRT(1 + 16 * s))
KERNEL(inverse_multiquadric, 1 / SQRT(1 + 16 * s), -16 / ((1 + 16 * s) * SQRT(1 + 16 * s)))
KERNEL(inverse_quadratic, 1 / (1 + 16 * s), -32 / ((1 + 16 * s) * (1 + 16 * s)))
KERNEL(linear, -SQRT(s), -1 / SQRT(AWAY(s)))
KERNEL(thin_plate, (REAL)0.5 * s * NAME(logarithm)(AWAY(s)), NAME(logarithm)(AWAY(s)) + 1)
KERNEL(cubic, s * SQRT(s), 3 * SQRT(s))
KERNEL(quintic, -s * s * SQRT(s), -5 * s * SQRT(s))

#undef KERNEL
