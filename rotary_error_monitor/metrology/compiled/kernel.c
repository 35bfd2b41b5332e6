/* Readings of heads at the ticks to rotation and place of the ring, compiled: encoder_heads.py and error_motion.py, which
 * say what it means and which tests hold this file against.
 *
 * The same operations on the same numbers in the same order as there, not contracted (-ffp-contract=off): the bits are
 * the same. What numpy has functions of its own for (sine, tangent, exponential) stays there. Nothing here needs Python:
 * kernel.py calls by ctypes. No function keeps anything, or writes anything but its outputs. */
#include <math.h>
#include <stdint.h>

#define ENTRY __attribute__((visibility("default")))
#define MOST_HEADS 7 /* of more, numpy adds in another order */
static const double TURN = 2.0 * 3.141592653589793;

ENTRY const char *rem_source(void) { return SOURCE; }

/* As HeadLayout: weights (3, h) and their products (9, h), parity (redundancy, h), projector (h, h), view (2, h). */
typedef struct {
    int64_t heads, redundancy;
    double sum; /* of the weights for the rotation */
    const double *weights, *products, *parity, *projector, *view;
} layout;

/* (m,), (2, m), (m, 3, 3), (m, redundancy), (m,), (2, m): displacements over the radius, before the tangent is taken. */
typedef struct {
    double *theta, *centre, *covariance, *parity, *disagreement, *seen;
} pose;

static double sum_over(int64_t h, const double *weights, const double *columns) {
    double total = weights[0] * columns[0];
    for (int64_t i = 1; i < h; i++) total += weights[i] * columns[i];
    return total;
}

/* Pose of the ring at m times from readings (m, h) with variances (m, h). */
ENTRY void rem_ring_pose(const layout *of, const double *readings, const double *variances, int64_t m, const pose *to) {
    const int64_t h = of->heads;
    for (int64_t j = 0; j < m; j++, readings += h, variances += h) {
        double relative[MOST_HEADS] = {0.0};
        for (int64_t i = 0; i < h; i++) {
            double apart = readings[i] - readings[0];
            relative[i] = apart - TURN * rint(apart / TURN);
        }
        to->theta[j] = readings[0] * of->sum + sum_over(h, of->weights, relative);
        for (int64_t a = 0; a < 2; a++) {
            to->centre[a * m + j] = sum_over(h, of->weights + (1 + a) * h, relative);
            if (to->seen) to->seen[a * m + j] = sum_over(h, of->view + a * h, relative);
        }
        for (int64_t a = 0; a < 9; a++) to->covariance[9 * j + a] = sum_over(h, of->products + a * h, variances);
        for (int64_t a = 0; a < of->redundancy; a++)
            to->parity[of->redundancy * j + a] = sum_over(h, of->parity + a * h, relative);
        to->disagreement[j] = 0.0;
        if (of->redundancy == 0) continue;
        double squares = 0.0;
        for (int64_t i = 0; i < h; i++) {
            double rest = sum_over(h, of->projector + i * h, relative), square = rest * rest / variances[i];
            squares = i == 0 ? square : squares + square;
        }
        to->disagreement[j] = sqrt(squares / (double)of->redundancy);
    }
}

/* Variances of m readings of k columns, as reading_variance: of noise, and of rounding to steps. */
ENTRY void rem_reading_variance(double noise, double resolution, double square, double unbroken, const double *gain,
                                int64_t gains, const double *travel, int64_t m, int64_t k, double *variance) {
    const double pi = 3.141592653589793;
    for (int64_t j = 0; j < m; j++)
        for (int64_t a = 0; a < k; a++) {
            double g = gain[gains == 1 ? j : j * k + a], rest = 1.0 - g;
            double steps = pi * travel[j * k + a] / resolution;
            double shared = unbroken / (1.0 + 2.0 * steps * steps);
            double rounding = (g + (rest >= 0.0 || rest != rest ? rest : 0.0) * shared) * square / 12.0;
            variance[j * k + a] = g * noise + rounding;
        }
}

/* Sums (n, columns) of k waves, from cosines and sines (k, n) of their angles and factors (k, columns). */
ENTRY void rem_wave_sum(const double *by_cos, const double *by_sin, int64_t k, int64_t columns, const double *cosines,
                        const double *sines, int64_t n, double *sums) {
    for (int64_t j = 0; j < n; j++)
        for (int64_t a = 0; a < columns; a++) {
            double total = 0.0;
            for (int64_t i = 0; i < k; i++)
                total += by_cos[i * columns + a] * cosines[i * n + j] + by_sin[i * columns + a] * sines[i * n + j];
            sums[j * columns + a] = total;
        }
}
