/* What the axes do to the tool, and axes that null a vector by least squares: as correction.py and kinematics.py. */
#ifndef AXES_H
#define AXES_H
#include "model.h"

/* Axes with an orthogonal basis and triangle (Gram-Schmidt) of their columns; rank counts those that add something. */
typedef struct {
    int64_t count, axes[MOST_AXES];
    lanes basis[MOST_AXES][3], triangle[MOST_AXES][MOST_AXES], rank;
} spanned;

/* Shift of the tool tip and rotation for a small step of each axis, as the workpiece sees them. */
INLINE void axis_columns(lanes (*shift)[3], lanes (*rotation)[3], const machine *m, const lines *ideal,
                         const frame *tool, const frame *work) {
    for (int64_t a = 0; a < m->axes; a++)
        THREE(i) shift[a][i] = rotation[a][i] = all(0.0);
    for (int64_t k = 0; k < m->tool_count + m->workpiece_count; k++) {
        int on_tool = k < m->tool_count;
        int64_t a = on_tool ? m->tool_axes[k] : m->workpiece_axes[k - m->tool_count];
        lanes direction[3], lever[3];
        THREE(i) {
            direction[i] = on_tool ? ideal->direction[a][i] : -ideal->direction[a][i];
            lever[i] = tool->p[i] - ideal->place[a][i];
        }
        if (m->rotary[a]) {
            rotate_back(rotation[a], (const lanes(*)[3])work->r, direction);
            lanes across[3];
            cross(across, direction, lever);
            memcpy(direction, across, sizeof direction);
        }
        rotate_back(shift[a], (const lanes(*)[3])work->r, direction);
    }
}

/* What the columns of rotary or of linear axes add to those before them; shorter than `least` counts as nothing. */
INLINE void orthogonal(spanned *found, const machine *m, int rotary, lanes (*columns)[3], double least) {
    found->count = 0;
    found->rank = all(0.0);
    for (int64_t a = 0; a < m->axes; a++) {
        if (m->rotary[a] != rotary) continue;
        int64_t i = found->count++;
        found->axes[i] = a;
        lanes rest[3] = {columns[a][0], columns[a][1], columns[a][2]};
        for (int64_t j = 0; j < i; j++) {
            lanes part = found->triangle[j][i] = dot(found->basis[j], rest);
            THREE(x) rest[x] -= part * found->basis[j][x];
        }
        lanes size = root(dot(rest, rest));
        mask used = size > least;
        found->triangle[i][i] = chosen(used, size, all(1.0));
        THREE(x) found->basis[i][x] = chosen(used, rest[x] / found->triangle[i][i], all(0.0));
        found->rank += chosen(used, all(1.0), all(0.0));
    }
}

/* Steps of these axes that take most of a vector away; an axis that adds nothing stays. */
INLINE void null_by(lanes *step, const spanned *by, const lanes *vector) {
    for (int64_t i = by->count - 1; i >= 0; i--) {
        lanes part = -dot(by->basis[i], vector);
        for (int64_t j = by->count - 1; j > i; j--) part -= by->triangle[i][j] * step[by->axes[j]];
        step[by->axes[i]] = part / by->triangle[i][i];
    }
}

#endif
