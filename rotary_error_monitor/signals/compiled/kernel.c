/* What is done with each block of samples and at each tick, compiled: admission.py, blocks.py and resampling.py, which
 * say what it means and which tests hold this file against.
 *
 * The same operations on the same numbers in the same order as there, not contracted (-ffp-contract=off): the bits are
 * the same. Nothing here needs Python: kernel.py calls by ctypes. No function keeps anything, or writes anything but its
 * outputs. */
#include <math.h>
#include <stdint.h>

#define ENTRY __attribute__((visibility("default")))

ENTRY const char *rem_source(void) { return SOURCE; }

/* Stamps (ns) of n samples whose rows of k numbers begin with seconds after `stamp`; the largest of them, or the least
 * number there is where a time is not finite, or further off than stamps of ROS messages reach. */
ENTRY int64_t rem_times(const double *rows, int64_t n, int64_t k, int64_t stamp, int64_t *times) {
    int64_t newest = INT64_MIN;
    for (int64_t i = 0; i < n; i++) {
        if (!(fabs(rows[i * k]) < 0x1p31)) return INT64_MIN;
        times[i] = stamp + (int64_t)rint(rows[i * k] * 1e9);
        if (times[i] > newest) newest = times[i];
    }
    return newest;
}

/* As SampleLimits of admission.py, and what is known of the samples before. */
typedef struct {
    double largest, speed, jitter, largest_bend; /* the bend is negative where spikes are not looked for */
    double taken_out, last; /* of the first value: whole turns that are taken out of it, and of the sample before */
    int64_t since, until;   /* stamp of the sample before, ns, and that of the latest which may come */
    int64_t is_first;       /* whether there is none before */
    const double *tail;     /* the last three samples that were judged for spikes, or NULL */
} limits;

static int bends(const double *before, const double *middle, const double *after, int64_t k, double largest) {
    for (int64_t a = 0; a < k; a++)
        if (fabs(after[a] - 2.0 * middle[a] + before[a]) > largest) return 1;
    return 0;
}

static int has_bends(const double *values, int64_t n, int64_t k, const limits *to) {
    const double *first = to->tail ? to->tail : values, *second = to->tail ? first + k : values + k;
    if (to->tail) {
        const double *third = second + k;
        if (bends(first, second, third, k, to->largest_bend)) return 1;
        if (bends(second, third, values, k, to->largest_bend)) return 1;
        if (n > 1 && bends(third, values, values + k, k, to->largest_bend)) return 1;
    }
    for (int64_t i = 2; i < n; i++)
        if (bends(values + (i - 2) * k, values + (i - 1) * k, values + i * k, k, to->largest_bend)) return 1;
    return 0;
}

/* Copies n samples of k values, which in rows of `width` numbers stand behind the time, where all of them are beyond
 * doubt; whether they are. */
ENTRY int64_t rem_admit(const limits *to, const double *rows, int64_t width, const int64_t *stamps, int64_t n, int64_t k,
                        int64_t *times, double *values) {
    int64_t before = to->since;
    double last = to->last;
    if (stamps[n - 1] > to->until) return 0;
    for (int64_t i = 0; i < n; i++) {
        const double *row = rows + i * width + 1;
        int first = i == 0 && to->is_first;
        if (!first && !(stamps[i] > before)) return 0;
        for (int64_t a = 0; a < k; a++) {
            if (!(fabs(row[a]) <= to->largest)) return 0;
            values[i * k + a] = row[a];
        }
        if (!isinf(to->speed)) {
            double turned = row[0] - to->taken_out;
            double step = first ? 0.0 : turned - last, passed = first ? 0.0 : (double)(stamps[i] - before) * 1e-9;
            if (!(fabs(step) <= to->speed * passed + to->jitter)) return 0;
            values[i * k] = last = turned;
        }
        times[i] = before = stamps[i];
    }
    return to->largest_bend < 0.0 || !has_bends(values, n, k, to);
}

/* How many of n rising stamps are before `when`. */
static int64_t place_of(const int64_t *stamps, int64_t n, int64_t when) {
    int64_t low = 0;
    while (low < n) {
        int64_t middle = low + (n - low) / 2;
        if (stamps[middle] < when) low = middle + 1;
        else n = middle;
    }
    return low;
}

/* Distance of two ticks, and from the beginning of a cell the part of it that is fitted, ns. */
typedef struct {
    int64_t period, fitted, fewest, max_gap;
    double margin;
} grid;

/* How many of m ticks, of which the first is `first` periods after the epoch, have all the samples that they will ever
 * need, of n samples. */
ENTRY int64_t rem_decided(const grid *of, const int64_t *stamps, int64_t n, int64_t first, int64_t m) {
    for (int64_t j = 0; j < m; j++) {
        int64_t begin = (first + j) * of->period, end = begin + of->fitted;
        if (stamps[n - 1] < end) return j;
        if (n > 1 && begin + of->period / 2 < stamps[n - 2]) continue;
        if (place_of(stamps, n, end) - place_of(stamps, n, begin) < of->fewest) return j;
    }
    return m;
}

/* Of one signal, and where its values go: (m, k), (m,), (m, k), (m, k) and whether they are valid (m,). */
typedef struct {
    const int64_t *stamps;
    const double *values;
    int64_t n, k;
    double *value, *gain, *travel, *bend;
    uint8_t *valid;
} signal;

static void fit(const grid *of, const signal *s, int64_t tick, int64_t j, int64_t start, int64_t stop) {
    const int64_t k = s->k, size = stop - start;
    const double period = (double)of->period;
    double until = (double)(s->stamps[stop - 1] - tick) / period;
    int covered = (double)(s->stamps[start] - tick + of->period / 2) <= of->margin &&
                  (double)(of->fitted - of->period / 2) - until * period <= of->margin;
    for (int64_t a = 0; a < k; a++) {
        double reference = s->values[start * k + a], y = 0.0;
        double s1 = 0.0, s2 = 0.0, s3 = 0.0, s4 = 0.0, t0 = 0.0, t1 = 0.0, t2 = 0.0;
        for (int64_t i = start; i < stop; i++) {
            double u = (double)(s->stamps[i] - tick) / period, u2 = u * u;
            y = s->values[i * k + a] - reference;
            s1 += u, s2 += u2, s3 += u2 * u, s4 += u2 * u2;
            t0 += y, t1 += u * y, t2 += u2 * y;
        }
        double c0 = s2 * s4 - s3 * s3, c1 = s2 * s3 - s1 * s4, c2 = s1 * s3 - s2 * s2;
        double determinant = (double)size * c0 + s1 * c1 + s2 * c2;
        double fitted = reference + (c0 * t0 + c1 * t1 + c2 * t2) / determinant;
        s->value[j * k + a] = covered ? fitted : 0.0;
        s->travel[j * k + a] = fabs(y);
        s->bend[j * k + a] = 0.0;
        if (a == 0) s->gain[j] = c0 / determinant;
    }
    s->valid[j] = (uint8_t)covered;
}

static int64_t larger(int64_t a, int64_t b) { return a > b ? a : b; }
static int64_t smaller(int64_t a, int64_t b) { return a < b ? a : b; }

/* Whether four samples are near to one another, and evenly enough, by their distances (ns): in whole numbers, for of
 * distances that are the limit itself, rounding would let through some ticks and not others. */
static int are_near(int64_t before, int64_t middle, int64_t behind, int64_t max_gap) {
    return middle <= 3 * smaller(before, behind) && larger(before, behind) <= 3 * middle &&
           larger(larger(before, behind), middle) <= max_gap;
}

static void interpolate(const grid *of, const signal *s, int64_t tick, int64_t j) {
    const int64_t k = s->k, after = place_of(s->stamps, s->n, tick + 1); /* those at the tick are before it */
    int64_t first = after - 2;
    if (first > s->n - 4) first = s->n - 4;
    if (first < 0) first = 0;
    double u[4], weight[4], gain = 0.0;
    for (int64_t i = 0; i < 4; i++) u[i] = (double)(s->stamps[first + i] - tick) * 1e-9;
    double middle = u[2] - u[1], before = u[1] - u[0], behind = u[3] - u[2];
    const int64_t *near = s->stamps + first;
    int valid = after >= 2 && after + 1 < s->n &&
                are_near(near[1] - near[0], near[2] - near[1], near[3] - near[2], of->max_gap);
    for (int i = 0; i < 4; i++) {
        weight[i] = 1.0;
        for (int l = 0; l < 4; l++)
            if (l != i) weight[i] = weight[i] * (u[l] / (u[l] - u[i]));
        gain = gain + weight[i] * weight[i];
    }
    double square = 2.0 / 3.0 * middle * sqrt((0.5 * middle + before) * (0.5 * middle + behind));
    double missed = 6.0 * square * sqrt(square) / (before + middle + behind);
    for (int64_t a = 0; a < k; a++) {
        double y[4], total = 0.0;
        for (int i = 0; i < 4; i++) y[i] = s->values[(first + i) * k + a];
        for (int i = 0; i < 4; i++) total = total + weight[i] * (y[i] - y[1]);
        double speeds[3] = {(y[1] - y[0]) / before, (y[2] - y[1]) / middle, (y[3] - y[2]) / behind};
        double one = (speeds[1] - speeds[0]) / (before + middle), other = (speeds[2] - speeds[1]) / (middle + behind);
        s->value[j * k + a] = valid ? y[1] + total : 0.0;
        s->travel[j * k + a] = fabs(y[3] - y[0]);
        s->bend[j * k + a] = (other - one) * missed;
    }
    s->gain[j] = gain;
    s->valid[j] = (uint8_t)valid;
}

static void nothing(const signal *s, int64_t j) {
    for (int64_t a = 0; a < s->k; a++)
        s->value[j * s->k + a] = s->travel[j * s->k + a] = s->bend[j * s->k + a] = 0.0;
    s->gain[j] = 1.0;
    s->valid[j] = 0;
}

/* Each of some signals at m ticks. */
ENTRY void rem_resample(const grid *of, const signal *signals, int64_t count, const int64_t *ticks, int64_t m) {
    for (const signal *s = signals; s < signals + count; s++)
        for (int64_t j = 0; j < m; j++) {
            int64_t begin = ticks[j] - of->period / 2;
            int64_t start = place_of(s->stamps, s->n, begin), stop = place_of(s->stamps, s->n, begin + of->fitted);
            if (stop - start >= of->fewest) fit(of, s, ticks[j], j, start, stop);
            else if (s->n >= 4) interpolate(of, s, ticks[j], j);
            else nothing(s, j);
        }
}
