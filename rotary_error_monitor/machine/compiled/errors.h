/* Error components of all axes at the poses of a chunk: as components.py, and `actual_errors` of error_model.py. */
#ifndef ERRORS_H
#define ERRORS_H
#include "model.h"

/* Linear between the places, and constant beyond the first and the last of them. */
INLINE double between(const double *at, const double *value, int64_t size, double x) {
    if (!(x > at[0])) return value[0];
    if (x >= at[size - 1]) return value[size - 1];
    int64_t low = 0, high = size - 1;
    while (high - low > 1) {
        int64_t middle = (low + high) / 2;
        if (x >= at[middle])
            low = middle;
        else
            high = middle;
    }
    return (value[high] - value[low]) / (at[high] - at[low]) * (x - at[low]) + value[low];
}

INLINE void add_tables(const machine *m, const poses *in, const chunk *at, const lanes *q, lanes (*errors)[6]) {
    const double *place = m->tables;
    for (int64_t k = 0; k < m->table_count; k++) {
        int64_t a = m->table_axis[k], size = m->table_size[k];
        lanes value;
        EACH_LANE {
            double x = q[a][l], sign = in->direction ? at->direction[a][l] : 0.0;
            double forward = between(place, place + size, size, x);
            double backward = between(place, place + 2 * size, size, x);
            value[l] = 0.5 * ((1.0 + sign) * forward + (1.0 - sign) * backward);
        }
        errors[a][m->table_component[k]] += value;
        place += 3 * size;
    }
}

/* Waves come sorted by axis and multiple: of a rotary axis's turns one follows from the one before it. */
INLINE void add_waves(const machine *m, const lanes *q, const lanes *s, const lanes *c, lanes (*errors)[6]) {
    int64_t axis = -1, multiple = 0;
    lanes sine = all(0.0), cosine = all(1.0);
    for (int64_t k = 0; k < m->wave_count; k++) {
        int64_t a = m->wave_axis[k];
        lanes here_s, here_c;
        if (m->wave_multiple[k]) {
            if (a != axis) sine = s[a], cosine = c[a], axis = a, multiple = 1;
            for (; multiple < m->wave_multiple[k]; multiple++) {
                lanes next = cosine * c[a] - sine * s[a];
                sine = sine * c[a] + cosine * s[a];
                cosine = next;
            }
            here_s = sine, here_c = cosine;
        } else {
            sine_cosine(m->wave_order[k] * q[a], &here_s, &here_c);
        }
        SIX(i) errors[a][i] += m->wave_cos[6 * k + i] * here_c + m->wave_sin[6 * k + i] * here_s;
    }
}

/* The live components are of the stator's frame; those that are NaN come from the description, as all others do. */
INLINE void put_live(lanes *errors, const lanes *live, lanes turn[3][3]) {
    for (int part = 0; part < 6; part += 3) {
        lanes told[3];
        rotate(told, (const lanes(*)[3])turn, errors + part);
        THREE(i) told[i] = chosen(live[part + i] == live[part + i], live[part + i], told[i]);
        rotate_back(errors + part, (const lanes(*)[3])turn, told);
    }
}

INLINE void errors_at(lanes (*errors)[6], const machine *m, const poses *in, const chunk *at, const lanes *q,
                      lanes (*turn)[3][3], const lanes *s, const lanes *c) {
    for (int64_t a = 0; a < m->axes; a++) {
        lanes u = (q[a] - m->middle[a]) / m->half_travel[a];
        const double *poly = m->poly + a;
        SIX(i) {
            int64_t k = m->terms - 1;
            lanes sum = all(poly[(6 * k + i) * m->axes]);
            while (k-- > 0) sum = sum * u + poly[(6 * k + i) * m->axes];
            errors[a][i] = sum;
        }
    }
    add_waves(m, q, s, c, errors);
    add_tables(m, in, at, q, errors);
    for (int64_t a = 0; a < m->axes; a++) {
        lanes along = all(0.0);
        if (in->temperature) along = m->expansion[a] * (at->temperature - m->reference_temperature) * q[a];
        if (in->direction) along += -0.5 * m->reversal[a] * at->direction[a];
        if (!in->temperature && !in->direction) continue;
        THREE(i) errors[a][m->rotary[a] ? 3 + i : i] += m->direction[i * m->axes + a] * along;
    }
    if (in->monitored) put_live(errors[m->monitored], at->live, turn[m->monitored]);
}

#endif
