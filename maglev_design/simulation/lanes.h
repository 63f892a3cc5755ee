/* The arithmetic that generated code is written in, for LANES doubles at once. */
#include <stdint.h>
#include <string.h>
#ifdef __AVX__
#include <immintrin.h>
#endif

#define LARGE 1.7976931348623157e308

typedef double real __attribute__((vector_size(8 * LANES)));
typedef double anywhere __attribute__((vector_size(8 * LANES), aligned(8)));
typedef int64_t mask __attribute__((vector_size(8 * LANES)));
typedef uint32_t word __attribute__((vector_size(4 * LANES)));
typedef uint32_t pair __attribute__((vector_size(8 * LANES)));
#define ZERO ((real){0})
#define WORD_ZERO ((word){0})

static inline real to_real(word x) { return __builtin_convertvector(x, real); }
static inline real chosen(mask m, real a, real b) { return (real)((m & (mask)a) | (~m & (mask)b)); }
static inline real truth(mask m) { return (real)(m & (mask)(ZERO + 1.0)); }
static inline real guarded(mask m, real a) { return (real)(m & (mask)a); }
static inline mask opposite(mask m) { return ~m; }
static inline real shared(mask own, mask other)
{
    return guarded(own, chosen(other, ZERO + 0.5, ZERO + 1.0));
}
static inline real absolute(real a) { return (real)((mask)a & 0x7fffffffffffffffLL); }
static inline real sign_of(real a) { return truth(a > 0.0) - truth(a < 0.0); }
static inline real root(real a)
{
    for (int k = 0; k < LANES; k++) a[k] = __builtin_sqrt(a[k]);
    return a;
}
static inline real exponential(real a)
{
    for (int k = 0; k < LANES; k++) a[k] = __builtin_exp(a[k]);
    return a;
}
static inline real logarithm(real a)
{
    for (int k = 0; k < LANES; k++) a[k] = __builtin_log(a[k]);
    return a;
}
static inline real lower(real a)
{
    for (int k = 0; k < LANES; k++) a[k] = __builtin_floor(a[k]);
    return a;
}
static inline int any(mask m)
{
    int64_t some = 0;
    for (int k = 0; k < LANES; k++) some |= m[k];
    return some != 0;
}
#if LANES == 4 && defined(__AVX__)
/* one instruction, the same as below bit for bit: it gives b where the comparison fails */
static inline real smaller(real a, real b) { return (real)_mm256_min_pd((__m256d)a, (__m256d)b); }
static inline real larger(real a, real b) { return (real)_mm256_max_pd((__m256d)a, (__m256d)b); }
#else
static inline real smaller(real a, real b) { return chosen(a < b, a, b); }
static inline real larger(real a, real b) { return chosen(a > b, a, b); }
#endif
