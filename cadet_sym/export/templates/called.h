/* Functions that the equations call: expectations that choose the order of their quadrature, and sums over many rows. */
#ifndef @P@_CALLED_H
#define @P@_CALLED_H
#include "@p@_real.h"

@prototypes@#endif
