/* The yardstick: one continuous TAN-GPI loop by hand, in plain scalar C.
 *
 * Runge-Kutta 4 with a fixed step; seven states: gap, speed, the law's two states, and the
 * integrals of e^2, |e| and t |e|. No crash test, no extremes, no noise, no sampling.
 * gcc -O3 -march=native -ffast-math.
 */
#include <math.h>

enum { STATES = 7 };

typedef struct {
    double gap, voltage;     /* Y, U */
    double static_gain;      /* C_Y/C_U */
    double acceleration;     /* -1/C_U */
    double error, slow, fast; /* the law's output matrix */
    double pole;             /* k3 */
    double beta, gravity, low, high;
} numbers;

static inline void rates(
    const double *x, double t, double y_ref, double acc_ref, double *dx, const numbers *p)
{
    const double e = x[0] - y_ref;
    double u = p->voltage + p->static_gain * (y_ref - p->gap) + p->acceleration * acc_ref
             + p->error * e + p->slow * x[2] + p->fast * x[3];
    u = u < p->low ? p->low : u > p->high ? p->high : u;
    dx[0] = x[1];
    dx[1] = p->gravity - p->beta * u * u / (x[0] * x[0]);
    dx[2] = e;
    dx[3] = e - p->pole * x[3];
    dx[4] = e * e;
    dx[5] = fabs(e);
    dx[6] = t * fabs(e);
}

/* `steps` steps of h; reference holds y*, y*'' at every half step. x is the state, in and out. */
void yardstick(long steps, double h, const double *reference, const numbers *p, double *x)
{
    double a[STATES], b[STATES], c[STATES], d[STATES], z[STATES];
    for (long k = 0; k < steps; k++) {
        const double t = (double)k * h, *r = reference + 4 * k;
        rates(x, t, r[0], r[1], a, p);
        for (int i = 0; i < STATES; i++) z[i] = x[i] + h / 2 * a[i];
        rates(z, t + h / 2, r[2], r[3], b, p);
        for (int i = 0; i < STATES; i++) z[i] = x[i] + h / 2 * b[i];
        rates(z, t + h / 2, r[2], r[3], c, p);
        for (int i = 0; i < STATES; i++) z[i] = x[i] + h * c[i];
        rates(z, t + h, r[4], r[5], d, p);
        for (int i = 0; i < STATES; i++) x[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
    }
}
