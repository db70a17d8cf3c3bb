/* Numbers and the mathematics of their precision, for the sources of this library only. */
#ifndef QUARTER_CAR_DAMPER_REAL_H
#define QUARTER_CAR_DAMPER_REAL_H
#include <float.h>
#include <math.h>
#include "quarter_car_damper.h"

typedef quarter_car_damper_real R;
#define K(number) ((R)(number))
#ifdef QUARTER_CAR_DAMPER_FLOAT
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
