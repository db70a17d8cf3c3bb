#include "oleo_constant_speed_real.h"

void oleo_constant_speed_initial(const R *restrict p, R *restrict y)
{
    (void)p;
    y[0] = K(0.0);
    y[1] = K(0.0);
    y[2] = K(0.0);
    y[3] = K(0.0);
    y[4] = K(0.0);
    y[5] = K(0.0);
    y[6] = K(0.0);
    y[7] = K(0.0);
    y[8] = K(0.0);
    y[9] = K(0.0);
    y[10] = K(0.0);
    y[11] = K(0.909090909090888);
    y[12] = K(1.3958616289524335e-14);
    y[13] = K(5.818181818181808);
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
