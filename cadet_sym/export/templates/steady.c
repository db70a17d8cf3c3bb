/* The moments at the start: stationary at the speed of the start; at the default parameters, for `start` to begin with. */
#include "@p@_real.h"

@tables@

void @p@_initial(const R *restrict p, R *restrict y)
{
    (void)p;
    for (int i = 0; i < @P@_SIZE; i++)
        y[i] = start[i];
}
