/* Where the axes stand at ticks, whether that fits the error motion, and the components that are carried to the body's
 * origin: joints.py, input_checks.py and live_components.py. */
#include "columns.h"

/* Joint states in memory, rows of positions, directions and whether the monitored axis is named; and those refused. */
typedef struct {
    const int64_t *stamps, *refused;
    const double *values, *quickest;
    const uint8_t *rotary;
    int64_t count, refusals, axes, lag;
    double longest_step, still;
} joints;

/* As AxisPositions, of m ticks. */
typedef struct {
    double *positions, *directions, *turned, *age, *stamped;
    int64_t *stamps;
    uint8_t *known, *told, *doubted;
} axes;

/* How many of n rising stamps are not after `when`. */
static int64_t up_to(const int64_t *stamps, int64_t n, int64_t when) {
    int64_t low = 0;
    while (low < n) {
        int64_t middle = low + (n - low) / 2;
        if (stamps[middle] <= when) low = middle + 1;
        else n = middle;
    }
    return low;
}

static double back_by(double moved, double speed, double lost, double still) {
    return 0.5 - 0.5 * (fabs(moved) > still && lost > speed ? speed / lost : 1.0);
}

/* Axes at m ticks by the joint states that are `lag` older; whether there is one for any of them. */
ENTRY int64_t rem_axes_at(const joints *of, const int64_t *ticks, int64_t m, const axes *to) {
    const int64_t a = of->axes, width = 2 * a + 1;
    int64_t any = 0;
    for (int64_t j = 0; j < m; j++) {
        int64_t wanted = ticks[j] - of->lag, here = up_to(of->stamps, of->count, wanted) - 1;
        to->known[j] = here >= 1;
        any |= here >= 1;
        if (here < 1) here = 0;
        const double *row = of->values + here * width, *last = here > 0 ? row - width : row;
        int64_t stamp = of->stamps[here];
        double step = (double)(stamp - of->stamps[here > 0 ? here - 1 : 0]) * 1e-9;
        double age = (double)(ticks[j] - stamp) * 1e-9;
        double part = step > 0.0 && step <= of->longest_step ? age / step : 0.0;
        for (int64_t i = 0; i < a; i++) {
            double moved = row[i] - last[i], passed = step > 0.0 ? step : INFINITY;
            if (of->rotary[i]) moved = moved - rint(moved / TURN) * TURN;
            to->positions[j * a + i] = row[i] + moved * part;
            to->stamped[j * a + i] = row[i];
            to->directions[j * a + i] = row[a + i];
            double speed = fabs(moved) / passed, lost = of->quickest[i] * (age + 0.5 * step);
            to->turned[j * a + i] = back_by(moved, speed, lost, of->still);
        }
        to->age[j] = age;
        to->stamps[j] = stamp;
        to->told[j] = row[2 * a] > 0.0;
        to->doubted[j] = up_to(of->refused, of->refusals, wanted) > up_to(of->refused, of->refusals, stamp);
    }
    return any;
}

/* Commands in memory, as Tolerances says how far joint states may be apart from them, and masks of doubts. */
typedef struct {
    const int64_t *stamps;
    int64_t count, largest_gap, age_limit, column, doubt_ring, doubt_unverified;
    double position, command;
} tolerances;

/* Of m ticks: command at the joint state's stamp and somewhat before; what follows of it. */
typedef struct {
    const double *command, *behind;
    const int64_t *doubts;
    double *difference;
    uint8_t *usable, *fits_command, *fresh, *agree, *fits, *proven;
} checked;

ENTRY void rem_judge(const tolerances *of, const axes *at, int64_t axes_count, int64_t m, int64_t verified,
                     const checked *to) {
    const int64_t n = of->count;
    for (int64_t j = 0; j < m; j++) {
        double off = at->stamped[j * axes_count + of->column] - to->command[j];
        off = off - TURN * rint(off / TURN);
        int64_t low = 0, high = n; /* the first command that is not before the joint state */
        while (low < high) {
            int64_t middle = low + (high - low) / 2;
            if (of->stamps[middle] < at->stamps[j]) low = middle + 1;
            else high = middle;
        }
        int64_t most = n > 1 ? n - 1 : 1, after = low < 1 ? 1 : low > most ? most : low;
        int64_t gap = of->stamps[after < n ? after : n - 1] - of->stamps[after - 1];
        int known = at->stamps[j] >= of->stamps[0] && gap <= of->largest_gap;
        double difference = known ? off : 0.0, allowed = of->command + fabs(to->command[j] - to->behind[j]);
        int fresh = at->known[j] && at->age[j] * 1e9 <= (double)of->age_limit, told = at->told[j] && fresh;
        verified = verified || !(to->doubts[j] & of->doubt_unverified);
        to->difference[j] = difference;
        to->fresh[j] = (uint8_t)fresh;
        to->agree[j] = !told || fabs(difference) <= of->position;
        to->fits_command[j] = !told || fabs(difference) <= allowed;
        to->fits[j] = !(to->doubts[j] & of->doubt_ring);
        to->proven[j] = (uint8_t)verified;
        to->usable[j] = fresh && !at->doubted[j] && to->agree[j] && to->fits[j] && to->proven[j];
    }
}

/* Components (m, 6) carried by weights (6, 6), NaN where what they depend on is not observable. */
ENTRY void rem_components(const double *weights, const double *components, const uint8_t *observable, int64_t m,
                          double *carried) {
    for (int64_t j = 0; j < m; j++, components += 6, observable += 6, carried += 6)
        for (int64_t row = 0; row < 6; row++) {
            double total = 0.0;
            int lost = 0;
            for (int64_t i = 0; i < 6; i++) {
                double weight = weights[6 * row + i];
                if (weight == 0.0) continue;
                total = total + weight * (observable[i] ? components[i] : 0.0);
                lost |= !observable[i];
            }
            carried[row] = lost ? NAN : total;
        }
}
