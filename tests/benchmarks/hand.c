/* Figs 9(b) and 16 as a C programmer would write them for speed: RK4, every stage in registers, what
   depends on time alone formed once per instant and carried to the next step, reciprocals formed once. */
#include <math.h>

#define INLINE static inline __attribute__((always_inline))

typedef struct {
    double amplitude, frequency, phase, offset;  /* reference */
    double ca1, ca2, cA, ctheta, cdelta;         /* model in the compensator */
    double a1, a2, A, theta, delta;              /* transmission */
    double kp, ki, kd, corner, low, high;        /* motor controller and drive; corner comes in as tau */
    double K, lag;                               /* motor; lag comes in as tau */
    double tip_kp, tip_ki, tip_kd, tip_corner;   /* tip controller, Fig 16 only */
} Numbers;

typedef struct { double x_ref, drive, decay, inverse; } Instant;

INLINE Instant at(const Numbers *n, double w, double t)
{
    double s = sin(w * t + n->phase), c = cos(w * t + n->phase);
    double v = n->amplitude * w * c, speed = fabs(v), E = exp(2 * v);
    Instant now = {
        n->offset + n->amplitude * s,
        n->cA * v + n->cdelta * speed,
        n->ctheta * speed,
        (E + 1) / (n->ca1 * E + n->ca2),
    };
    return now;
}

/* x: controller integral and filter, angle, speed, estimate, zeta, then (Fig 16) tip integral and filter */
INLINE void rates(const Numbers *n, int tip, Instant now, const double *x, double *dx, double *log)
{
    double v = x[3], speed = fabs(v), E = exp(2 * v);
    double x_out = (n->a1 * E + n->a2) / (E + 1) * x[2] + x[5];
    double x_ff = (now.x_ref - x[4]) * now.inverse, command = x_ff, miss = 0, d_tip = 0, pid = 0;
    if (tip) {
        miss = now.x_ref - x_out;
        d_tip = (miss - x[7]) * n->tip_corner;
        pid = n->tip_kp * miss + n->tip_ki * x[6] + n->tip_kd * d_tip;
        command = x_ff + pid;
        dx[6] = miss;
        dx[7] = d_tip;
    }
    double e = command - x[2], d = (e - x[1]) * n->corner;
    double wanted = n->kp * e + n->ki * x[0] + n->kd * d;
    double u = wanted < n->low ? n->low : wanted;
    u = u > n->high ? n->high : u;
    dx[0] = e;
    dx[1] = d;
    dx[2] = v;
    dx[3] = (n->K * u - v) * n->lag;
    dx[4] = now.drive - now.decay * x[4];
    dx[5] = n->A * v + speed * (n->delta - n->theta * x[5]);
    if (!log) return;
    log[0] = now.x_ref; log[1] = x_ff; log[2] = e; log[3] = wanted; log[4] = u;
    log[5] = x[2]; log[6] = v; log[7] = x_out;
    for (int k = 0; k < 6; k++) log[8 + k] = x[k];
    if (tip) { log[14] = miss; log[15] = pid; log[16] = command; log[17] = x[6]; log[18] = x[7]; }
}

INLINE void run(const double *given, int tip, double h, long steps, double *log)
{
    Numbers n = *(const Numbers *)given;
    n.corner = 1 / n.corner; n.lag = 1 / n.lag;
    if (tip) n.tip_corner = 1 / n.tip_corner;
    const double w = 6.283185307179586 * n.frequency, half = h / 2, third = h / 3, sixth = h / 6;
    const int states = tip ? 8 : 6, columns = tip ? 19 : 14;
    double x[8] = {0}, b[8], k1[8], k2[8], k3[8], k4[8];
    Instant now = at(&n, w, 0);
    for (long i = 0;; i++) {
        rates(&n, tip, now, x, k1, log + columns * i);
        if (i == steps) break;
        now = at(&n, w, i * h + half);
        for (int k = 0; k < states; k++) b[k] = x[k] + half * k1[k];
        rates(&n, tip, now, b, k2, 0);
        for (int k = 0; k < states; k++) b[k] = x[k] + half * k2[k];
        rates(&n, tip, now, b, k3, 0);
        for (int k = 0; k < states; k++) b[k] = x[k] + h * k3[k];
        now = at(&n, w, (i + 1) * h);
        rates(&n, tip, now, b, k4, 0);
        for (int k = 0; k < states; k++) x[k] += sixth * (k1[k] + k4[k]) + third * (k2[k] + k3[k]);
    }
}

void fig09b(const double *restrict given, double h, long steps, double *restrict log) { run(given, 0, h, steps, log); }
void fig16(const double *restrict given, double h, long steps, double *restrict log) { run(given, 1, h, steps, log); }
