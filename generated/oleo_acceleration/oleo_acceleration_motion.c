#include "oleo_acceleration_real.h"

void oleo_acceleration_start_parts(const R *restrict p, R *restrict parts)
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
    parts[11] = K(-0.4);
    parts[12] = K(1.0);
    parts[13] = K(-2.2);
    parts[14] = K(0.0);
    parts[15] = K(0.0);
    parts[16] = K(0.0);
    parts[17] = K(1.6);
    parts[18] = K(0.0);
    parts[19] = K(1.2649110640673518);
}

void oleo_acceleration_motion(R t, const R *restrict p, R *restrict motion)
{
    const R a0 = p[4] * t;
    motion[0] = a0;
    motion[1] = p[4];
    const R a3 = K(0.5) * p[4];
    const R a4 = t * t;
    const R a5 = a3 * a4;
    motion[2] = a5;
    motion[3] = K(0.0);
}

void oleo_acceleration_switches(R t, R s, const R *restrict p, R *restrict g)
{
    (void)t;
    (void)s;
    (void)p;
    (void)g;
}
