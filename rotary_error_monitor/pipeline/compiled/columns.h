/* Columns of the evidence, in the order of `Means` in evidence.py; of a vector its first component. */
#ifndef COLUMNS
#include <math.h>
#include <stdint.h>

#define ENTRY __attribute__((visibility("default")))
#define COLUMNS 27
enum {
    THETA, HEADS, RADIAL, HEAD_SAMPLES, AGREEMENT, BELIEVED_AGREEMENT, COMMAND, TURNS, ECC, HEAD_BEND, COMMAND_BEND,
    CENTRE, CENTRE_Y, SURPLUS, SURPLUS_Y, DESCRIBED, DESCRIBED_Y, RADIAL_VARIANCE, TILT, TILT_SAMPLES, TILT_READ,
    TILT_READ_Y, TILT_SURPLUS, TILT_SURPLUS_Y, TILT_VARIANCE, COMMANDED, VELOCITY
};

static const double TURN = 2.0 * 3.141592653589793;

/* As numpy's: NaN where either is. */
static inline double larger(double a, double b) { return a >= b || a != a ? a : b; }
#endif
