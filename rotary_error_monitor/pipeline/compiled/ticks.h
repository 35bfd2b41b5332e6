/* What ticks show, put together: `_put_ring`, `_put_tilt` and `_put_command` of ticks.py. */
#include "columns.h"

/* The ring, as RingPose and what the description predicts of its displacement; `variance` NULL: that of the poses; mean
 * third differences of its heads. */
typedef struct {
    const double *theta, *centre, *radial, *described, *predicted, *seen, *covariance, *disagreement, *variance, *bend;
    int64_t sees_x, sees_y;
    double samples;
} ring;

/* The tilt: what is read, less what the mirror shows of itself, less error motion; and its variance, all (m, 2). */
typedef struct {
    const double *read, *tilt, *surplus, *variance;
    double samples;
} tilt;

/* The command (m,), and third differences (m, count) of the heads and of it. */
typedef struct {
    const double *angle, *bends;
    int64_t count;
    double missed;
} command;

/* Arrays of ErrorMotion, and the evidence (m, COLUMNS), all of them zero at first. */
typedef struct {
    int64_t count;
    double *theta, *components, *covariance, *seen;
    uint8_t *observable;
} motion;

static void put_ring(const motion *to, const ring *from, int64_t j) {
    double *components = to->components + 6 * j, *covariance = to->covariance + 36 * j, *seen = to->seen + COLUMNS * j;
    uint8_t *observable = to->observable + 6 * j;
    const double *known = from->covariance + 9 * j;
    const int64_t sees[2] = {from->sees_x, from->sees_y};
    to->theta[j] = from->theta[j];
    for (int a = 0; a < 2; a++) {
        if (sees[a]) {
            components[a] = from->radial[2 * j + a];
            covariance[7 * a] = known[4 * (1 + a)];
            observable[a] = 1;
            seen[CENTRE + a] = from->centre[2 * j + a];
        }
        seen[SURPLUS + a] = from->seen[2 * j + a] - from->predicted[2 * j + a];
        seen[DESCRIBED + a] = from->described[2 * j + a];
    }
    covariance[1] = covariance[6] = known[5];
    seen[THETA] = from->theta[j];
    seen[HEADS] = 1.0;
    seen[RADIAL] = from->sees_x && from->sees_y;
    seen[BELIEVED_AGREEMENT] = from->disagreement[j] * from->disagreement[j];
    seen[RADIAL_VARIANCE] = from->variance ? from->variance[j] : larger(known[4], known[8]);
    seen[HEAD_SAMPLES] = from->samples;
    seen[HEAD_BEND] = from->bend[j];
}

static void put_tilt(const motion *to, const tilt *from, int64_t j) {
    double *covariance = to->covariance + 36 * j, *seen = to->seen + COLUMNS * j;
    for (int a = 0; a < 2; a++) {
        covariance[7 * (3 + a)] = from->variance[2 * j + a];
        to->components[6 * j + 3 + a] = from->tilt[2 * j + a];
        to->observable[6 * j + 3 + a] = 1;
        seen[TILT_READ + a] = from->read[2 * j + a];
        seen[TILT_SURPLUS + a] = from->surplus[2 * j + a];
    }
    seen[TILT] = 1.0;
    seen[TILT_SAMPLES] = from->samples;
    seen[TILT_VARIANCE] = covariance[21];
}

static void put_command(const motion *to, const command *from, const ring *of, int64_t j) {
    const double *bends = from->bends + from->count * j, *known = of->covariance + 9 * j;
    double *covariance = to->covariance + 36 * j, *seen = to->seen + COLUMNS * j, most = fabs(bends[0]);
    double distance = of->theta[j] - from->angle[j], turns = rint(distance / TURN);
    distance = distance - TURN * turns;
    to->theta[j] -= TURN * turns;
    to->components[6 * j + 5] = distance;
    to->observable[6 * j + 5] = 1;
    for (int64_t i = 1; i < from->count - 1; i++) most = larger(most, fabs(bends[i]));
    covariance[35] = known[0] + from->missed * (most * most + bends[from->count - 1] * bends[from->count - 1]);
    for (int a = 0; a < 2; a++) covariance[6 * a + 5] = covariance[30 + a] = known[1 + a];
    seen[COMMAND] = 1.0;
    seen[ECC] = distance;
    seen[COMMAND_BEND] = bends[from->count - 1];
    seen[TURNS] = turns;
}

/* What of the streams is not there is NULL. */
ENTRY void rem_put(const motion *to, const ring *heads, const tilt *mirror, const command *asked) {
    for (int64_t j = 0; j < to->count; j++) {
        put_ring(to, heads, j);
        if (mirror) put_tilt(to, mirror, j);
        if (asked) put_command(to, asked, heads, j);
    }
}
