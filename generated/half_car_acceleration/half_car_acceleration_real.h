/* Numbers and the mathematics of their precision, for the sources of this library only. */
#ifndef HALF_CAR_ACCELERATION_REAL_H
#define HALF_CAR_ACCELERATION_REAL_H
#include <float.h>
#include <math.h>
#include "half_car_acceleration.h"

typedef half_car_acceleration_real R;
#define K(number) ((R)(number))
#ifdef HALF_CAR_ACCELERATION_FLOAT
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
