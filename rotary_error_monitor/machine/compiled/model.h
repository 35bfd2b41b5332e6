/* A machine and where it stands at the poses of a chunk: as components.py and kinematics.py. */
#ifndef MOST_AXES
#define MOST_AXES 16
#include "lanes.h"

/* Arrays as in MachineModel and ErrorComponents, each in one piece; fixtures are (3, 4, axes) and (3, 4). */
typedef struct {
    int64_t axes, tool_count, workpiece_count, terms, wave_count, table_count, monitored;
    const int64_t *tool_axes, *workpiece_axes, *rotary;
    const double *direction, *middle, *half_travel, *poly, *expansion, *reversal;
    const double *ideal_axes, *ideal_tool, *ideal_workpiece, *actual_axes, *actual_tool, *actual_workpiece;
    const int64_t *wave_axis, *wave_multiple; /* multiple of the rotary axis's angle, or 0: take the order */
    const double *wave_order, *wave_cos, *wave_sin;
    const int64_t *table_axis, *table_component, *table_size;
    const double *tables; /* of each table its positions, forward and backward values */
    double reference_temperature;
} machine;

/* Rows of n poses; what may be NULL is not known. */
typedef struct {
    int64_t count;
    const double *positions, *added, *direction, *temperature, *monitored, *ideal;
} poses;

typedef struct {
    double r[3][3], p[3];
    int turns;
} fixture;

typedef struct {
    fixture axes[MOST_AXES], tool, workpiece;
} fixtures;

/* One chunk of poses. */
typedef struct {
    lanes q[MOST_AXES], added[MOST_AXES], direction[MOST_AXES], temperature, live[6];
} chunk;

/* Where the axes act: direction of each and where it stands, in the base. */
typedef struct {
    lanes direction[MOST_AXES][3], place[MOST_AXES][3];
} lines;

INLINE fixture fixture_at(const double *values, int64_t stride) {
    fixture f;
    f.turns = 0;
    THREE(i) {
        THREE(j) {
            f.r[i][j] = values[(4 * i + j) * stride];
            f.turns |= f.r[i][j] != (i == j);
        }
        f.p[i] = values[(4 * i + 3) * stride];
    }
    return f;
}

INLINE void read_fixtures(fixtures *f, const machine *m, const double *axes, const double *tool, const double *work) {
    for (int64_t a = 0; a < m->axes; a++) f->axes[a] = fixture_at(axes + a, m->axes);
    f->tool = fixture_at(tool, 1);
    f->workpiece = fixture_at(work, 1);
}

INLINE void begin(frame *t, const fixture *f) {
    THREE(i) {
        t->p[i] = all(f->p[i]);
        THREE(j) t->r[i][j] = all(f->r[i][j]);
    }
}

INLINE void go_on(frame *t, const fixture *f) {
    THREE(i) {
        const lanes *r = t->r[i];
        t->p[i] = (r[0] * f->p[0] + r[1] * f->p[1] + r[2] * f->p[2]) + t->p[i];
    }
    if (!f->turns) return;
    lanes b[3][3];
    THREE(i)
        THREE(j) b[i][j] = all(f->r[i][j]);
    compose(t->r, (const lanes(*)[3])b);
}

INLINE void turn_by(lanes turn[3][3], const double *d, int64_t stride, lanes s, lanes c) {
    double x[3] = {d[0], d[stride], d[2 * stride]}, size = x[0] * x[0] + x[1] * x[1] + x[2] * x[2];
    lanes rest = 1.0 - c;
    THREE(i) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        lanes even = rest * (x[i] * x[j]), odd = s * x[k];
        turn[i][i] = 1.0 + rest * (x[i] * x[i] - size);
        turn[i][j] = even - odd;
        turn[j][i] = even + odd;
    }
}

/* Turns of the rotary axes at q, and sine and cosine of their angles. */
INLINE void turn_axes(const machine *m, const lanes *q, lanes (*turn)[3][3], lanes *s, lanes *c) {
    for (int64_t a = 0; a < m->axes; a++) {
        if (!m->rotary[a]) continue;
        sine_cosine(q[a], &s[a], &c[a]);
        turn_by(turn[a], m->direction + a, m->axes, s[a], c[a]);
    }
}

/* One branch: T = Tp dTp Ts dTs, axis after axis; of the ideal machine where there are no errors. */
INLINE void stand_branch(frame *t, const machine *m, const int64_t *axes, int64_t count, const fixtures *f,
                         const fixture *end, const lanes *q, lanes (*turn)[3][3], lanes (*errors)[6], lines *found) {
    begin(t, count ? &f->axes[axes[0]] : end);
    for (int64_t k = 0; k < count; k++) {
        int64_t a = axes[k];
        const double *d = m->direction + a;
        lanes along[3] = {all(d[0]), all(d[m->axes]), all(d[2 * m->axes])}, moved[3];
        if (k) go_on(t, &f->axes[a]);
        if (m->rotary[a]) {
            compose(t->r, (const lanes(*)[3])turn[a]);
        } else {
            rotate(moved, (const lanes(*)[3])t->r, along);
            THREE(i) t->p[i] += moved[i] * q[a];
        }
        if (errors) {
            lanes small[3][3];
            rotate(moved, (const lanes(*)[3])t->r, errors[a]);
            THREE(i) t->p[i] += moved[i];
            rotation_by(small, errors[a] + 3);
            compose(t->r, (const lanes(*)[3])small);
        }
        if (found) {
            rotate(found->direction[a], (const lanes(*)[3])t->r, along);
            memcpy(found->place[a], t->p, sizeof t->p);
        }
    }
    if (count) go_on(t, end);
}

/* T_workpiece^-1 T_tool; the workpiece's own rotation is left in `work` for who needs it. */
INLINE void stand(frame *seen, frame *tool, frame *work, const machine *m, const fixtures *f, const lanes *q,
                  lanes (*turn)[3][3], lanes (*errors)[6], lines *found) {
    stand_branch(tool, m, m->tool_axes, m->tool_count, f, &f->tool, q, turn, errors, found);
    stand_branch(work, m, m->workpiece_axes, m->workpiece_count, f, &f->workpiece, q, turn, errors, found);
    lanes apart[3];
    THREE(i) {
        apart[i] = tool->p[i] - work->p[i];
        THREE(j)
            seen->r[i][j] =
                work->r[0][i] * tool->r[0][j] + work->r[1][i] * tool->r[1][j] + work->r[2][i] * tool->r[2][j];
    }
    rotate_back(seen->p, (const lanes(*)[3])work->r, apart);
}

#endif
