#include "duffing_real.h"

void duffing_initial(const R *restrict p, R *restrict y)
{
    (void)p;
    y[0] = K(0.0);
    y[1] = K(0.0);
    y[2] = K(0.0);
    y[3] = K(0.0);
    y[4] = K(0.0);
}

void duffing_motion(R t, const R *restrict p, R *restrict motion)
{
    (void)t;
    (void)p;
    motion[0] = K(0.0);
    motion[1] = K(0.0);
    motion[2] = K(0.0);
    motion[3] = K(0.0);
}

void duffing_switches(R t, R s, const R *restrict p, R *restrict g)
{
    (void)t;
    (void)s;
    (void)p;
    (void)g;
}
