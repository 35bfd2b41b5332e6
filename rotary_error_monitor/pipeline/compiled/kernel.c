/* What is done at each tick of estimate and offset, compiled: ticks.py, publication.py, joints.py, input_checks.py and
 * live_components.py, which say what it means and which tests hold this file against.
 *
 * The same operations on the same numbers in the same order as there, not contracted (-ffp-contract=off): the bits are
 * the same. What numpy has functions of its own for (sine, products of matrices) stays there. Nothing here needs Python:
 * kernel.py calls by ctypes. No function keeps anything, or writes anything but its outputs. */
#include "columns.h"
#include "joints.h"
#include "publication.h"
#include "ticks.h"

ENTRY const char *rem_source(void) { return SOURCE; }
