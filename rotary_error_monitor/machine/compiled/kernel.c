/* The exact multi-body model and the search for axis corrections, compiled: the formulas of error_model.py and
 * correction.py, which say what they mean and which tests hold this file against.
 *
 * LANES poses are evaluated at once, one in each lane of a vector; a call with fewer repeats its last pose in the lanes
 * that are left. So each lane sees the same operations in the same order however many poses there are, and what a pose
 * gives does not depend on the others, to the last bit. Sums of products are not contracted (-ffp-contract=off) and
 * sines are computed here, so the bits are the same on processors with and without fused operations.
 *
 * Nothing here needs Python: kernel.py builds `machine` and calls by ctypes. No function keeps or writes anything but
 * its outputs. Functions return -1, or the number of the first pose with an input that is not finite. */
#include "axes.h"
#include "errors.h"

#define ENTRY_ONCE __attribute__((visibility("default")))
#ifdef ENTRY
#elif defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
/* built for each width of vectors, of which the loader picks what the processor has */
#define ENTRY __attribute__((visibility("default"), target_clones("avx512f", "avx2", "default")))
#else
#define ENTRY __attribute__((visibility("default")))
#endif

INLINE void read_rows(lanes *columns, mask *wrong, const double *rows, int64_t width, const int64_t *row) {
    for (int64_t a = 0; a < width; a++) {
        EACH_LANE columns[a][l] = rows[row[l] * width + a];
        *wrong |= ~(columns[a] - columns[a] == 0.0);
    }
}

/* Poses `first` and those after it, poses last; -1, or the first of them that is not finite. */
INLINE int64_t read_chunk(chunk *at, const machine *m, const poses *in, int64_t first) {
    int64_t row[LANES];
    mask wrong = {0};
    EACH_LANE row[l] = first + l < in->count ? first + l : in->count - 1;
    read_rows(at->q, &wrong, in->positions, m->axes, row);
    if (in->added) read_rows(at->added, &wrong, in->added, m->axes, row);
    if (in->temperature) read_rows(&at->temperature, &wrong, in->temperature, 1, row);
    if (in->direction) {
        read_rows(at->direction, &wrong, in->direction, m->axes, row);
        for (int64_t a = 0; a < m->axes; a++) {
            lanes d = at->direction[a], one = all(1.0), none = all(0.0);
            at->direction[a] = chosen(d > 0.0, one, none) - chosen(d < 0.0, one, none);
        }
    }
    if (in->monitored) {
        mask unused = {0};
        read_rows(at->live, &unused, in->monitored, 6, row);
        SIX(i) wrong |= magnitude(at->live[i]) == INFINITY;
    }
    if (any(wrong)) EACH_LANE if (wrong[l]) return row[l];
    return -1;
}

INLINE void read_ideal(frame *ideal, const poses *in, int64_t first) {
    EACH_LANE {
        const double *values = in->ideal + (first + l < in->count ? first + l : in->count - 1);
        THREE(i) {
            THREE(j) ideal->r[i][j][l] = values[(4 * i + j) * in->count];
            ideal->p[i][l] = values[(4 * i + 3) * in->count];
        }
    }
}

INLINE void stand_ideal(frame *seen, frame *tool, frame *work, const machine *m, const fixtures *f, const lanes *q,
                        lines *found) {
    lanes turn[MOST_AXES][3][3], s[MOST_AXES], c[MOST_AXES];
    turn_axes(m, q, turn, s, c);
    stand(seen, tool, work, m, f, q, turn, NULL, found);
}

INLINE void stand_actual(frame *seen, const machine *m, const fixtures *f, const poses *in, const chunk *at,
                         const lanes *q) {
    lanes turn[MOST_AXES][3][3], s[MOST_AXES], c[MOST_AXES], errors[MOST_AXES][6];
    frame tool, work;
    turn_axes(m, q, turn, s, c);
    errors_at(errors, m, in, at, q, turn, s, c);
    stand(seen, &tool, &work, m, f, q, turn, errors, NULL);
}

INLINE void write_rows(double *rows, const lanes *columns, int64_t width, int64_t first, int64_t count) {
    for (int64_t l = 0; l < LANES && first + l < count; l++)
        for (int64_t a = 0; a < width; a++) rows[(first + l) * width + a] = columns[a][l];
}

/* What the loader asks for: whether this is the library of the sources beside it. */
ENTRY_ONCE const char *rem_source(void) { return SOURCE; }

/* (n, 6) offset at q + added against the ideal machine at q, or against `ideal` (3, 4, n). */
ENTRY int64_t rem_offsets(const machine *m, const poses *in, double *offset) {
    fixtures still, actual;
    read_fixtures(&still, m, m->ideal_axes, m->ideal_tool, m->ideal_workpiece);
    read_fixtures(&actual, m, m->actual_axes, m->actual_tool, m->actual_workpiece);
    for (int64_t first = 0; first < in->count; first += LANES) {
        chunk at;
        frame ideal, seen, tool, work;
        lanes found[6];
        int64_t wrong = read_chunk(&at, m, in, first);
        if (wrong >= 0) return wrong;
        if (in->ideal)
            read_ideal(&ideal, in, first);
        else
            stand_ideal(&ideal, &tool, &work, m, &still, at.q, NULL);
        if (in->added)
            for (int64_t a = 0; a < m->axes; a++) at.q[a] += at.added[a];
        stand_actual(&seen, m, &actual, in, &at, at.q);
        offset_between(found, &seen, &ideal);
        write_rows(offset, found, 6, first, in->count);
    }
    return -1;
}

/* One pose's search in each lane: steps until none is longer than `last_step`; lanes that are done stay.
 * Gives which are not done. */
INLINE mask search(lanes *delta, lanes *offset, const machine *m, const fixtures *actual, const poses *in,
                   const chunk *at, const frame *ideal, const spanned *rotary, const spanned *linear,
                   lanes (*shift)[3], int64_t most_steps, double last_step) {
    mask active = all(0.0) == 0.0;
    for (int64_t a = 0; a < m->axes; a++) delta[a] = all(0.0);
    int64_t k = 0;
    do {
        lanes q[MOST_AXES], step[MOST_AXES], away[3], turned[3];
        frame seen;
        for (int64_t a = 0; a < m->axes; a++) q[a] = at->q[a] + delta[a];
        stand_actual(&seen, m, actual, in, at, q);
        if (k == 0) offset_between(offset, &seen, ideal);
        THREE(i) {
            turned[i] = seen.r[i][2] - ideal->r[i][2];
            away[i] = seen.p[i] - ideal->p[i];
        }
        null_by(step, rotary, turned);
        for (int64_t j = 0; j < rotary->count; j++)
            THREE(i) away[i] += shift[rotary->axes[j]][i] * step[rotary->axes[j]];
        null_by(step, linear, away);
        mask longer = {0};
        for (int64_t a = 0; a < m->axes; a++) {
            delta[a] = chosen(active, delta[a] + step[a], delta[a]);
            longer |= magnitude(step[a]) > last_step;
        }
        active &= longer;
    } while (++k < most_steps && any(active));
    return active;
}

/* Corrections (n, axes) and offset (n, 6); flags (n, 3): converged, position spanned, direction spanned. */
ENTRY int64_t rem_corrections(const machine *m, const poses *in, double least_reach, int64_t most_steps,
                              double last_step, double *corrections, double *offset, uint8_t *flags) {
    fixtures still, actual;
    read_fixtures(&still, m, m->ideal_axes, m->ideal_tool, m->ideal_workpiece);
    read_fixtures(&actual, m, m->actual_axes, m->actual_tool, m->actual_workpiece);
    for (int64_t first = 0; first < in->count; first += LANES) {
        chunk at;
        frame ideal, tool, work;
        lines where;
        spanned rotary, linear;
        lanes shift[MOST_AXES][3], rotation[MOST_AXES][3], delta[MOST_AXES], found[6];
        int64_t wrong = read_chunk(&at, m, in, first);
        if (wrong >= 0) return wrong;
        stand_ideal(&ideal, &tool, &work, m, &still, at.q, &where);
        axis_columns(shift, rotation, m, &where, &tool, &work);
        for (int64_t a = 0; a < m->axes; a++) {
            lanes axis[3] = {ideal.r[0][2], ideal.r[1][2], ideal.r[2][2]}, across[3];
            cross(across, rotation[a], axis);
            memcpy(rotation[a], across, sizeof across);
        }
        orthogonal(&rotary, m, 1, rotation, least_reach);
        orthogonal(&linear, m, 0, shift, least_reach);
        mask active = search(delta, found, m, &actual, in, &at, &ideal, &rotary, &linear, shift, most_steps, last_step);
        write_rows(corrections, delta, m->axes, first, in->count);
        write_rows(offset, found, 6, first, in->count);
        for (int64_t l = 0; l < LANES && first + l < in->count; l++) {
            flags[3 * (first + l)] = !active[l];
            flags[3 * (first + l) + 1] = linear.rank[l] == 3.0;
            flags[3 * (first + l) + 2] = rotary.rank[l] == 2.0;
        }
    }
    return -1;
}
