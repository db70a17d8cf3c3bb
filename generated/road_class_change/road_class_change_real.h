/* Numbers and the mathematics of their precision, for the sources of this library only. */
#ifndef ROAD_CLASS_CHANGE_REAL_H
#define ROAD_CLASS_CHANGE_REAL_H
#include <float.h>
#include <math.h>
#include "road_class_change.h"

typedef road_class_change_real R;
#define K(number) ((R)(number))
#ifdef ROAD_CLASS_CHANGE_FLOAT
#define M(function) function##f
#define TINY(number) ((number) < 0.0 ? -1e-30f : 1e-30f) /* what keeps a division by a variance finite */
#define ROUNDING FLT_EPSILON
#define SMALLEST FLT_MIN
#define FINITE(x) ((x) - (x) == 0.0f)
#else
#define M(function) function
#define TINY(number) ((R)(number))
#define ROUNDING DBL_EPSILON
#define SMALLEST DBL_MIN
#define FINITE(x) ((x) - (x) == 0.0)
#endif
#endif
