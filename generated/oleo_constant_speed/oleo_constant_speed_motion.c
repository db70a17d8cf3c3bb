#include "oleo_constant_speed_real.h"

void oleo_constant_speed_start_parts(const R *restrict p, R *restrict parts)
{
    (void)p;
    parts[0] = K(0.0);
    parts[1] = K(0.0);
    parts[2] = K(0.0);
    parts[3] = K(0.0);
    parts[4] = K(0.0);
    parts[5] = K(0.0);
    parts[6] = K(0.0);
    parts[7] = K(0.0);
    parts[8] = K(0.0);
    parts[9] = K(0.0);
    parts[10] = K(0.0);
    parts[11] = K(-6.4);
    parts[12] = K(1.0);
    parts[13] = K(-8.8);
    parts[14] = K(0.0);
    parts[15] = K(0.0);
    parts[16] = K(0.0);
    parts[17] = K(102.4);
    parts[18] = K(0.0);
    parts[19] = K(10.119288512538814);
}

void oleo_constant_speed_motion(R t, const R *restrict p, R *restrict motion)
{
    motion[0] = p[4];
    motion[1] = K(0.0);
    const R a2 = p[4] * t;
    motion[2] = a2;
    motion[3] = K(0.0);
}

void oleo_constant_speed_switches(R t, R s, const R *restrict p, R *restrict g)
{
    (void)t;
    (void)s;
    (void)p;
    (void)g;
}
