/* One sensor step of BearingDoppler, by hand: what the processor can do when nothing stands in its way.

   The observer turns and flies, the emitter manoeuvres, bearing and Doppler are heard, the unscented filter predicts
   and corrects, the Cramér–Rao bound and its noise-free copy follow, the reward's terms are added up. Environments lie
   side by side, several to a register; matrices are symmetric and held by their lower halves, row by row. Openings,
   decisions and observations are left out, and so is every care for covariances that rounding has spoilt. The errors
   of a step are drawn beforehand, from a generator in each environment. */

#include <math.h>

struct numbers {
    double period, turn_rate, bearing_sigma, doppler_sigma, shift;
    double track_noise, bound_noise, spread, correction, min_range, margin;
};

/* Where each number of an environment is among the rows. */
enum {
    TRUTH = 0,          /* east, north, their rates */
    OWN = 4,            /* east, north, heading, turn rate, forward axis */
    SET_POINT = 10,
    SPEED = 11,
    BEGIN = 12, LASTS, PUSH, TURN, KIND,
    MEAN = 17,
    COVARIANCE = 21,
    BOUND = 31,
    FREE = 41,          /* the bound without process noise */
    ERRORS = 51,        /* of the measurement, in deviations */
    NIS = 53,
    BOUND_TERM = 54, GRAM_TERM, ERROR_TERM, KEEP_OUT_TERM,
    CLOSEST = 58
};

#define AT(row) state[(row) * stride + i]

/* The compiler would make one call of sine and cosine, and of that it knows no form for several numbers at once. */
static inline double cosine_of(double angle) { return sin(M_PI_2 - angle); }

static inline double wrapped(double angle) { return angle - 2.0 * M_PI * rint(angle * (0.5 / M_PI)); }
static inline double least(double a, double b) { return a < b ? a : b; }
static inline double most(double a, double b) { return a > b ? a : b; }

/* C = F C F' + q G G' of constant velocity, G = (T^2/2, T) on each axis. */
static inline void predict(double *c, double t, double q) {
    double a = 0.25 * q * t * t * t * t, b = 0.5 * q * t * t * t, d = q * t * t;
    c[0] += t * (2.0 * c[3] + t * c[5]) + a;
    c[1] += t * (c[6] + c[4] + t * c[8]);
    c[2] += t * (2.0 * c[7] + t * c[9]) + a;
    c[3] += t * c[5] + b;
    c[4] += t * c[8];
    c[6] += t * c[8];
    c[7] += t * c[9] + b;
    c[5] += d;
    c[9] += d;
}

/* C -= s s' / v for a whitened row h, s = C h; returns v. */
static inline double absorb(double *c, const double *h) {
    double s0 = c[0] * h[0] + c[1] * h[1] + c[3] * h[2] + c[6] * h[3];
    double s1 = c[1] * h[0] + c[2] * h[1] + c[4] * h[2] + c[7] * h[3];
    double s2 = c[3] * h[0] + c[4] * h[1] + c[5] * h[2] + c[8] * h[3];
    double s3 = c[6] * h[0] + c[7] * h[1] + c[8] * h[2] + c[9] * h[3];
    double v = 1.0 + h[0] * s0 + h[1] * s1 + h[2] * s2 + h[3] * s3, w = 1.0 / v;
    double w0 = w * s0, w1 = w * s1, w2 = w * s2, w3 = w * s3;
    c[0] -= w0 * s0;
    c[1] -= w1 * s0;
    c[2] -= w1 * s1;
    c[3] -= w2 * s0;
    c[4] -= w2 * s1;
    c[5] -= w2 * s2;
    c[6] -= w3 * s0;
    c[7] -= w3 * s1;
    c[8] -= w3 * s2;
    c[9] -= w3 * s3;
    return v;
}

/* A number in [1, 2) from the upper bits of a word. */
static inline double one_to_two(unsigned long word) {
    union { unsigned long bits; double number; } both = {.bits = (word >> 12) | 0x3FF0000000000000UL};
    return both.number;
}

#define SEED(word) seeds[(word) * stride + i]

/* Two standard normals for every environment, by Box and Muller from xoshiro256+. */
void draw_errors(double *restrict state, unsigned long *restrict seeds, long stride, long environments) {
#pragma GCC ivdep
    for (long i = 0; i < environments; i++) {
        unsigned long a = SEED(0), b = SEED(1), c = SEED(2), d = SEED(3), word[2];
        for (int k = 0; k < 2; k++) {
            word[k] = a + d;
            unsigned long shifted = b << 17;
            c ^= a;
            d ^= b;
            b ^= c;
            a ^= d;
            c ^= shifted;
            d = (d << 45) | (d >> 19);
        }
        SEED(0) = a;
        SEED(1) = b;
        SEED(2) = c;
        SEED(3) = d;
        double length = sqrt(-2.0 * log(2.0 - one_to_two(word[0])));
        double angle = 2.0 * M_PI * (one_to_two(word[1]) - 1.5);
        AT(ERRORS) = length * sin(angle);
        AT(ERRORS + 1) = length * cosine_of(angle);
    }
}

void sensor_step(double *restrict state, long stride, long environments, double time, const struct numbers *given) {
    const struct numbers p = *given;
    const double t = p.period, weight = 0.5 / p.spread;
#pragma GCC ivdep
    for (long i = 0; i < environments; i++) {
        /* The observer: an arc, then straight on. */
        double flies = AT(SPEED);
        double limit = p.turn_rate * t, turn = wrapped(AT(SET_POINT) - AT(OWN + 2));
        turn = most(least(turn, limit), -limit);
        double size = fabs(turn), sine = sin(0.5 * turn), cosine = cosine_of(0.5 * turn);
        double chord = 2.0 / p.turn_rate * fabs(sine), straight = t - size / p.turn_rate;
        double mx = cosine * AT(OWN + 4) + sine * AT(OWN + 5), my = cosine * AT(OWN + 5) - sine * AT(OWN + 4);
        double fx = cosine * mx + sine * my, fy = cosine * my - sine * mx;
        double ox = AT(OWN) + flies * (chord * mx + straight * fx);
        double oy = AT(OWN + 1) + flies * (chord * my + straight * fy);
        AT(OWN) = ox;
        AT(OWN + 1) = oy;
        AT(OWN + 2) += turn;
        AT(OWN + 3) = size < limit ? 0.0 : turn / t;
        AT(OWN + 4) = fx;
        AT(OWN + 5) = fy;

        /* The emitter: speed and course change while the manoeuvre lasts. */
        double overlap = least(time + t, AT(BEGIN) + AT(LASTS)) - most(time, AT(BEGIN));
        overlap = most(overlap, 0.0);
        double kind = AT(KIND), pushes = kind - 2.0 * floor(0.5 * kind), turns = kind >= 2.0 ? 1.0 : 0.0;
        double gain = 0.5 * AT(PUSH) * pushes * overlap, half = 0.5 * AT(TURN) * turns * overlap;
        double vx = AT(TRUTH + 2), vy = AT(TRUTH + 3), speed = most(sqrt(vx * vx + vy * vy), 1e-9);
        double sh = sin(half), ch = cosine_of(half), square = half * half, small = fabs(half) < 0.05 ? 1.0 : 0.0;
        double j0 = half == 0.0 ? 1.0 : sh / half;
        double series = half / 3.0 * (1.0 - square / 10.0 * (1.0 - square / 28.0 * (1.0 - square / 54.0)));
        double j1 = small != 0.0 ? series : (sh - half * ch) / (small != 0.0 ? 1.0 : square);
        double ux = (ch * vx + sh * vy) / speed, uy = (ch * vy - sh * vx) / speed;
        double along = (speed + gain) * j0, across = gain * j1;
        double tx = AT(TRUTH) + t * (along * ux + across * uy), ty = AT(TRUTH + 1) + t * (along * uy - across * ux);
        double after = speed + 2.0 * gain;
        vx = after * (ch * ux + sh * uy);
        vy = after * (ch * uy - sh * ux);
        AT(TRUTH) = tx;
        AT(TRUTH + 1) = ty;
        AT(TRUTH + 2) = vx;
        AT(TRUTH + 3) = vy;

        /* What is heard. */
        double dx = tx - ox, dy = ty - oy, wx = vx - flies * fx, wy = vy - flies * fy;
        double range = most(sqrt(dx * dx + dy * dy), 1e-3), near = 1.0 / range;
        double rate = (dx * wx + dy * wy) * near;
        double bearing = atan2(dx, dy) + p.bearing_sigma * AT(ERRORS);
        double doppler = p.shift * rate + p.doppler_sigma * AT(ERRORS + 1);

        /* The filter: predict, and draw sigma points. */
        double x0 = AT(MEAN), x1 = AT(MEAN + 1), x2 = AT(MEAN + 2), x3 = AT(MEAN + 3), c[10];
        for (int k = 0; k < 10; k++) c[k] = AT(COVARIANCE + k);
        x0 += t * x2;
        x1 += t * x3;
        predict(c, t, p.track_noise);
        double r0 = 1.0 / sqrt(p.spread * c[0]), l0 = p.spread * c[0] * r0;
        double l1 = p.spread * c[1] * r0, l3 = p.spread * c[3] * r0, l6 = p.spread * c[6] * r0;
        double q2 = p.spread * c[2] - l1 * l1, r2 = 1.0 / sqrt(q2), l2 = q2 * r2;
        double l4 = (p.spread * c[4] - l3 * l1) * r2, l7 = (p.spread * c[7] - l6 * l1) * r2;
        double l5 = sqrt(p.spread * c[5] - l3 * l3 - l4 * l4), l8 = (p.spread * c[8] - l6 * l3 - l7 * l4) / l5;
        double l9 = sqrt(p.spread * c[9] - l6 * l6 - l7 * l7 - l8 * l8);

        double ex = x0 - ox, ey = x1 - oy, sx = x2 - flies * fx, sy = x3 - flies * fy;
        double inverse = 1.0 / most(sqrt(ex * ex + ey * ey), 1e-3);
        double centre = atan2(ex, ey), tone = p.shift * (ex * sx + ey * sy) * inverse;
        double plus[4][2], minus[4][2];
        double px[2] = {l0, 0.0}, py[2] = {l1, l2}, qx[2] = {l3, l4}, qy[2] = {l6, l7};
        for (int j = 0; j < 2; j++) {
            double ax = ex + px[j], ay = ey + py[j], bx = ex - px[j], by = ey - py[j];
            double ai = 1.0 / most(sqrt(ax * ax + ay * ay), 1e-3), bi = 1.0 / most(sqrt(bx * bx + by * by), 1e-3);
            plus[j][0] = wrapped(atan2(ax, ay) - centre);
            minus[j][0] = wrapped(atan2(bx, by) - centre);
            plus[j][1] = p.shift * (ax * (sx + qx[j]) + ay * (sy + qy[j])) * ai - tone;
            minus[j][1] = p.shift * (bx * (sx - qx[j]) + by * (sy - qy[j])) * bi - tone;
        }
        double fast = p.shift * inverse;
        plus[2][0] = minus[2][0] = plus[3][0] = minus[3][0] = 0.0;
        plus[2][1] = fast * (ex * l5 + ey * l8);
        minus[2][1] = -plus[2][1];
        plus[3][1] = fast * ey * l9;
        minus[3][1] = -plus[3][1];

        /* Correct. */
        double m0 = 0.0, m1 = 0.0, s0 = 0.0, s1 = 0.0, s2 = 0.0, g[4][2];
        for (int j = 0; j < 4; j++) {
            m0 += plus[j][0] + minus[j][0];
            m1 += plus[j][1] + minus[j][1];
            s0 += plus[j][0] * plus[j][0] + minus[j][0] * minus[j][0];
            s1 += plus[j][0] * plus[j][1] + minus[j][0] * minus[j][1];
            s2 += plus[j][1] * plus[j][1] + minus[j][1] * minus[j][1];
            g[j][0] = weight * (plus[j][0] - minus[j][0]);
            g[j][1] = weight * (plus[j][1] - minus[j][1]);
        }
        m0 *= weight;
        m1 *= weight;
        s0 = weight * s0 + p.correction * m0 * m0 + p.bearing_sigma * p.bearing_sigma;
        s1 = weight * s1 + p.correction * m0 * m1;
        s2 = weight * s2 + p.correction * m1 * m1 + p.doppler_sigma * p.doppler_sigma;
        double i0 = 1.0 / sqrt(s0), low = s1 * i0, i2 = 1.0 / sqrt(s2 - low * low);
        double z0 = (wrapped(bearing - centre) - m0) * i0, z1 = (doppler - tone - m1 - low * z0) * i2;
        double k[4][2];
        for (int b = 0; b < 2; b++) {
            k[0][b] = l0 * g[0][b];
            k[1][b] = l1 * g[0][b] + l2 * g[1][b];
            k[2][b] = l3 * g[0][b] + l4 * g[1][b] + l5 * g[2][b];
            k[3][b] = l6 * g[0][b] + l7 * g[1][b] + l8 * g[2][b] + l9 * g[3][b];
        }
        for (int j = 0; j < 4; j++) {
            k[j][0] *= i0;
            k[j][1] = (k[j][1] - low * k[j][0]) * i2;
        }
        AT(MEAN) = x0 += k[0][0] * z0 + k[0][1] * z1;
        AT(MEAN + 1) = x1 += k[1][0] * z0 + k[1][1] * z1;
        AT(MEAN + 2) = x2 + k[2][0] * z0 + k[2][1] * z1;
        AT(MEAN + 3) = x3 + k[3][0] * z0 + k[3][1] * z1;
        AT(COVARIANCE) = c[0] - k[0][0] * k[0][0] - k[0][1] * k[0][1];
        AT(COVARIANCE + 1) = c[1] - k[1][0] * k[0][0] - k[1][1] * k[0][1];
        AT(COVARIANCE + 2) = c[2] - k[1][0] * k[1][0] - k[1][1] * k[1][1];
        AT(COVARIANCE + 3) = c[3] - k[2][0] * k[0][0] - k[2][1] * k[0][1];
        AT(COVARIANCE + 4) = c[4] - k[2][0] * k[1][0] - k[2][1] * k[1][1];
        AT(COVARIANCE + 5) = c[5] - k[2][0] * k[2][0] - k[2][1] * k[2][1];
        AT(COVARIANCE + 6) = c[6] - k[3][0] * k[0][0] - k[3][1] * k[0][1];
        AT(COVARIANCE + 7) = c[7] - k[3][0] * k[1][0] - k[3][1] * k[1][1];
        AT(COVARIANCE + 8) = c[8] - k[3][0] * k[2][0] - k[3][1] * k[2][1];
        AT(COVARIANCE + 9) = c[9] - k[3][0] * k[3][0] - k[3][1] * k[3][1];
        AT(NIS) = z0 * z0 + z1 * z1;

        /* The bound, at the true geometry. */
        double flat = near * near / p.bearing_sigma, scale = p.shift / p.doppler_sigma;
        double hx = dx * near, hy = dy * near;
        double hb[4] = {dy * flat, -dx * flat, 0.0, 0.0};
        double hd[4] = {scale * near * (wx - rate * hx), scale * near * (wy - rate * hy), scale * hx, scale * hy};
        for (int n = 0; n < 10; n++) c[n] = AT(BOUND + n);
        predict(c, t, p.bound_noise);
        absorb(c, hb);
        absorb(c, hd);
        for (int n = 0; n < 10; n++) AT(BOUND + n) = c[n];
        double sigma = sqrt(most(hx * hx * c[0] + 2.0 * hx * hy * c[1] + hy * hy * c[2], 1e-12));
        for (int n = 0; n < 10; n++) c[n] = AT(FREE + n);
        predict(c, t, 0.0);
        double growth = absorb(c, hb);
        growth *= absorb(c, hd);
        for (int n = 0; n < 10; n++) AT(FREE + n) = c[n];

        /* The reward. */
        double fault = sqrt((x0 - tx) * (x0 - tx) + (x1 - ty) * (x1 - ty)) * near;
        double depth = (1.0 + p.margin - range / p.min_range) / p.margin;
        AT(BOUND_TERM) -= log(sigma * near);
        AT(GRAM_TERM) += log(growth);
        AT(ERROR_TERM) -= least(fault, 1.0);
        AT(KEEP_OUT_TERM) -= least(most(depth, 0.0), 1.0);
        AT(CLOSEST) = least(AT(CLOSEST), range);
    }
}
