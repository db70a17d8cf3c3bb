#include "duffing_real.h"

void duffing_start_parts(const R *restrict p, R *restrict parts)
{
    (void)p;
    parts[0] = K(0.0);
    parts[1] = K(0.0);
    parts[2] = K(0.0);
    parts[3] = K(0.0);
    parts[4] = K(0.0);
    parts[5] = K(0.0);
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
