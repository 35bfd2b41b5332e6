/* LANES numbers at once, and vectors, rotations and frames of them: as transforms.py, one pose in each lane. */
#ifndef LANES
#include <math.h>
#include <stdint.h>
#include <string.h>

#define LANES 8
#define EACH_LANE for (int l = 0; l < LANES; l++)
#define THREE(i) _Pragma("GCC unroll 3") for (int i = 0; i < 3; i++)
#define SIX(i) _Pragma("GCC unroll 6") for (int i = 0; i < 6; i++)
#define INLINE static inline __attribute__((always_inline))

typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef int64_t mask __attribute__((vector_size(8 * LANES))); /* of each lane all bits or none */

typedef struct {
    lanes r[3][3], p[3];
} frame;

INLINE lanes all(double x) {
    lanes v;
    EACH_LANE v[l] = x;
    return v;
}

INLINE lanes chosen(mask m, lanes a, lanes b) { return (lanes)(((mask)a & m) | ((mask)b & ~m)); }

INLINE lanes magnitude(lanes x) { return (lanes)((mask)x & INT64_MAX); }

INLINE lanes root(lanes x) {
    EACH_LANE x[l] = sqrt(x[l]);
    return x;
}

INLINE int any(mask m) {
    int64_t found = 0;
    EACH_LANE found |= m[l];
    return found != 0;
}

INLINE lanes dot(const lanes *a, const lanes *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

INLINE void cross(lanes *out, const lanes *a, const lanes *b) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

INLINE void rotate(lanes *out, const lanes r[3][3], const lanes *v) {
    lanes x = v[0], y = v[1], z = v[2];
    THREE(i) out[i] = r[i][0] * x + r[i][1] * y + r[i][2] * z;
}

INLINE void rotate_back(lanes *out, const lanes r[3][3], const lanes *v) {
    lanes x = v[0], y = v[1], z = v[2];
    THREE(i) out[i] = r[0][i] * x + r[1][i] * y + r[2][i] * z;
}

INLINE void compose(lanes a[3][3], const lanes b[3][3]) {
    THREE(i) {
        lanes x = a[i][0], y = a[i][1], z = a[i][2];
        THREE(j) a[i][j] = x * b[0][j] + y * b[1][j] + z * b[2][j];
    }
}

/* Reduction by Cody and Waite; polynomials of fdlibm's k_sin.c and k_cos.c, of which the notice is: Copyright (C) 1993
 * by Sun Microsystems, Inc. All rights reserved. Developed at SunPro, a Sun Microsystems, Inc. business. Permission to
 * use, copy, modify, and distribute this software is freely granted, provided that this notice is preserved. */
INLINE void sine_cosine(lanes x, lanes *sine, lanes *cosine) {
    const double whole = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to an integer, in the lowest bits */
    lanes turns = x * 0.63661977236758134308 + whole;
    mask quarter = (mask)turns;
    turns -= whole;
    /* pi / 2 in three parts: products with the first two, of 33 bits each, are exact up to 2^20 quarters */
    lanes r = ((x - turns * 1.57079632673412561417) - turns * 6.07710050630396597660e-11) -
              turns * 2.02226624879595063154e-21;
    lanes z = r * r;
    lanes s = z * 1.58969099521155010221e-10 - 2.50507602534068634195e-08;
    s = z * s + 2.75573137070700676789e-06;
    s = z * s - 1.98412698298579493134e-04;
    s = z * s + 8.33333333332248946124e-03;
    s = z * s - 1.66666666666666324348e-01;
    s = r + r * z * s;
    lanes c = z * -1.13596475577881948265e-11 + 2.08757232129817482790e-09;
    c = z * c - 2.75573143513906633035e-07;
    c = z * c + 2.48015872894767294178e-05;
    c = z * c - 1.38888888888741095749e-03;
    c = z * c + 4.16666666666666019037e-02;
    lanes half = 0.5 * z, rest = 1.0 - half;
    c = rest + (((1.0 - rest) - half) + z * z * c);
    mask odd = -(quarter & 1);
    *sine = (lanes)((mask)chosen(odd, c, s) ^ ((quarter & 2) << 62));
    *cosine = (lanes)((mask)chosen(odd, s, c) ^ (((quarter + 1) & 2) << 62));
    mask far = ~(magnitude(x) < 1e6); /* also what is no number */
    if (__builtin_expect(any(far), 0)) {
        EACH_LANE if (far[l]) {
            (*sine)[l] = sin(x[l]);
            (*cosine)[l] = cos(x[l]);
        }
    }
}

/* Rotation by the rotation vector v: 1 + sin(a)/a [v]x + (1 - cos a)/a^2 [v]x^2. */
INLINE void rotation_by(lanes r[3][3], const lanes *v) {
    lanes t = dot(v, v);
    /* Taylor series; up to a = 0.1 the next term is below 1e-17 */
    lanes s = 1.0 - t * (1.0 / 6 - t * (1.0 / 120 - t * (1.0 / 5040 - t * (1.0 / 362880))));
    lanes c = 0.5 - t * (1.0 / 24 - t * (1.0 / 720 - t * (1.0 / 40320 - t * (1.0 / 3628800))));
    mask large = ~(t < 0.01);
    if (__builtin_expect(any(large), 0)) {
        EACH_LANE if (large[l]) {
            double a = sqrt(t[l]), half = sin(0.5 * a) / a;
            s[l] = sin(a) / a;
            c[l] = 2.0 * half * half;
        }
    }
    lanes square[3] = {v[0] * v[0], v[1] * v[1], v[2] * v[2]};
    THREE(i) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        lanes even = c * v[i] * v[j], odd = s * v[k];
        r[i][i] = 1.0 - c * (square[j] + square[k]);
        r[i][j] = even - odd;
        r[j][i] = even + odd;
    }
}

/* x, y, z and rotation vector of actual ideal^T. */
INLINE void offset_between(lanes *out, const frame *actual, const frame *ideal) {
    lanes r[3][3];
    THREE(i) {
        out[i] = actual->p[i] - ideal->p[i];
        THREE(j) r[i][j] = dot(actual->r[i], ideal->r[j]);
    }
    lanes v[3] = {0.5 * (r[2][1] - r[1][2]), 0.5 * (r[0][2] - r[2][0]), 0.5 * (r[1][0] - r[0][1])};
    lanes t = dot(v, v), cosine = 0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0);
    /* series of asin(s) / s; up to s = 0.01 the next term is below 1e-17 */
    lanes scale = 1.0 + t * (1.0 / 6 + t * (3.0 / 40 + t * (15.0 / 336)));
    mask large = ~((t < 1e-4) & (cosine > 0.0));
    if (__builtin_expect(any(large), 0)) {
        EACH_LANE if (large[l]) {
            double s = sqrt(t[l]);
            scale[l] = s > 1e-8 ? atan2(s, cosine[l]) / s : 1.0;
        }
    }
    THREE(i) out[3 + i] = v[i] * scale;
}

#endif
