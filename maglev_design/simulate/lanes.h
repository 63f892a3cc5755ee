/* The arithmetic that generated code is written in, for LANES doubles at once or for one. */
#include <stdint.h>

#define LARGE 1.7976931348623157e308

#if LANES > 1
typedef double real __attribute__((vector_size(8 * LANES)));
typedef int64_t mask __attribute__((vector_size(8 * LANES)));
typedef uint32_t word __attribute__((vector_size(4 * LANES)));
#define ZERO ((real){0})
#define WORD_ZERO ((word){0})
static inline real to_real(word x) { return __builtin_convertvector(x, real); }
static inline real chosen(mask m, real a, real b) { return (real)((m & (mask)a) | (~m & (mask)b)); }
static inline real truth(mask m) { return (real)(m & (mask)(ZERO + 1.0)); }
static inline real guarded(real c, real a) { return (real)((c != 0.0) & (mask)a); }
static inline real absolute(real a) { return (real)((mask)a & 0x7fffffffffffffffLL); }
static inline real root(real a)
{
    for (int k = 0; k < LANES; k++) a[k] = __builtin_sqrt(a[k]);
    return a;
}
static inline real lower(real a)
{
    for (int k = 0; k < LANES; k++) a[k] = __builtin_floor(a[k]);
    return a;
}
static inline int any_negative(real a)
{
    mask m = a < 0.0;
    int64_t any = 0;
    for (int k = 0; k < LANES; k++) any |= m[k];
    return any != 0;
}
#else
typedef double real;
typedef int mask;
typedef uint32_t word;
#define ZERO 0.0
#define WORD_ZERO 0u
static inline real to_real(word x) { return (real)x; }
static inline real chosen(mask m, real a, real b) { return m ? a : b; }
static inline real truth(mask m) { return m ? 1.0 : 0.0; }
static inline real guarded(real c, real a) { return c != 0.0 ? a : 0.0; }
static inline real absolute(real a) { return __builtin_fabs(a); }
static inline real root(real a) { return __builtin_sqrt(a); }
static inline real lower(real a) { return __builtin_floor(a); }
static inline int any_negative(real a) { return a < 0.0; }
#endif

static inline real smaller(real a, real b) { return chosen(a < b, a, b); }
static inline real larger(real a, real b) { return chosen(a > b, a, b); }
static inline real sign_of(real a) { return truth(a > 0.0) - truth(a < 0.0); }
