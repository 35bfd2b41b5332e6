/* What of an estimate goes out, and how uncertain it is: `finish` of publication.py. */
#include "columns.h"

/* Columns of what is believed: as `Believed` of publication.py. */
enum {
    HEAD_SCALE, TILT_SCALE, LAG, UNRESOLVED, UNRESOLVED_TILT, MOST, REACH_TILT, REACH_ECC = REACH_TILT + 3,
    REACH_RADIAL = REACH_ECC + 3, REALS = REACH_RADIAL + 3
};
enum { EXCLUDED, DOUBTS, SETTLED, INTEGERS };

/* Variances and limits of a stage; masks of streams and of doubts. */
typedef struct {
    double most, sigmas, unseen, unproven_radial, unproven_tilt, radial, tilt, along, across, radius_square, rounding;
    int64_t autocollimator, command, heads, commanded;
    int64_t doubt_heads, doubt_ring, doubt_unverified, doubt_unverified_tilt;
} stated;

/* `bounds` by redundancy; `distorted` (m, 2) by distortion of the autocollimator, or NULL. */
typedef struct {
    int64_t count;
    const double *theta, *seen, *disagreement, *reals, *bounds, *distorted;
    const int64_t *redundancy;
    double *components, *covariance;
    uint8_t *observable;
    int64_t *integers, *streams;
    uint8_t *publish;
} ticks;

static int within(const double *reach, double x, double y) {
    return fabs(x - reach[0]) <= reach[2] && fabs(y - reach[1]) <= reach[2];
}

static void hide(const ticks *at, int64_t j, int64_t place) {
    double *covariance = at->covariance + 36 * j;
    at->observable[6 * j + place] = 0;
    at->components[6 * j + place] = 0.0;
    for (int64_t a = 0; a < 6; a++) covariance[6 * place + a] = covariance[6 * a + place] = 0.0;
}

static void raise_uncertainty(const stated *of, const ticks *at, int64_t j, int64_t doubts) {
    static const int64_t by_heads[3] = {0, 1, 5};
    const double *seen = at->seen + COLUMNS * j, *reals = at->reals + REALS * j;
    double *covariance = at->covariance + 36 * j;
    const int alone = at->redundancy[j] == 0;
    double bound = at->bounds[at->redundancy[j]];
    double heads = larger(reals[HEAD_SCALE] * reals[HEAD_SCALE], at->disagreement[j] * at->disagreement[j] / bound);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) covariance[6 * by_heads[a] + by_heads[b]] *= heads;
    double unproven = doubts & of->doubt_unverified ? of->unproven_radial : 0.0;
    double step = alone ? of->unseen : 0.0, head = alone ? unproven : 0.0;
    double radial = of->radial + 0.5 * (reals[UNRESOLVED] * reals[UNRESOLVED]);
    radial += unproven;
    double tilt = of->tilt + 0.5 * (reals[UNRESOLVED_TILT] * reals[UNRESOLVED_TILT]);
    tilt += doubts & of->doubt_unverified_tilt ? of->unproven_tilt : 0.0;
    double x = seen[TILT_READ], y = seen[TILT_READ_Y];
    double about_x = of->along * (x * x) + of->across * (y * y), about_y = of->along * (y * y) + of->across * (x * x);
    if (at->distorted) about_x += at->distorted[2 * j], about_y += at->distorted[2 * j + 1];
    double lag = reals[LAG] * reals[LAG];
    const double added[6] = {step + radial, step + radial, 0.0, tilt + about_x, tilt + about_y,
                             (step + head) / of->radius_square + lag + of->rounding};
    for (int p = 0; p < 6; p++) {
        if (p == 2) continue;
        if (p == 3 || p == 4) covariance[7 * p] *= reals[TILT_SCALE] * reals[TILT_SCALE];
        covariance[7 * p] += at->observable[6 * j + p] ? added[p] : 0.0;
    }
}

static int all_finite(const double *numbers, int64_t n) {
    for (int64_t i = 0; i < n; i++)
        if (!isfinite(numbers[i])) return 0;
    return 1;
}

ENTRY void rem_publish(const stated *of, const ticks *at) {
    for (int64_t j = 0; j < at->count; j++) {
        const double *seen = at->seen + COLUMNS * j, *reals = at->reals + REALS * j;
        int64_t *integers = at->integers + INTEGERS * j, streams = at->streams[j];
        if (seen[TILT] > 0.0 && !within(reals + REACH_TILT, seen[TILT_SURPLUS], seen[TILT_SURPLUS_Y]))
            streams &= ~of->autocollimator;
        if (seen[COMMAND] > 0.0 && !within(reals + REACH_ECC, seen[ECC], 0.0)) streams &= ~of->command;
        if (at->redundancy[j] == 0 && (streams & of->heads & ~integers[SETTLED])) integers[DOUBTS] |= of->doubt_unverified;
        int64_t doubts = integers[DOUBTS];
        raise_uncertainty(of, at, j, doubts);
        double radial = hypot(seen[SURPLUS] + seen[DESCRIBED], seen[SURPLUS_Y] + seen[DESCRIBED_Y]);
        int told = (streams & of->command) != 0;
        if ((doubts & of->doubt_ring) || radial > of->most + of->sigmas * sqrt(seen[RADIAL_VARIANCE]))
            hide(at, j, 0), hide(at, j, 1);
        if (!(streams & of->autocollimator)) hide(at, j, 3), hide(at, j, 4);
        if (!told) hide(at, j, 5);
        at->streams[j] = streams;
        at->publish[j] = at->disagreement[j] <= reals[MOST] &&
                         within(reals + REACH_RADIAL, seen[SURPLUS], seen[SURPLUS_Y]) &&
                         !(doubts & of->doubt_heads) && !(of->commanded && !told) && isfinite(at->theta[j]) &&
                         all_finite(at->components + 6 * j, 6) && all_finite(reals, MOST) &&
                         all_finite(at->covariance + 36 * j, 36);
    }
}
