#include "oleo_acceleration_real.h"

void oleo_acceleration_initial(const R *restrict p, R *restrict y)
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
    y[11] = K(0.9090909090909084);
    y[12] = K(5.704502864621112e-17);
    y[13] = K(0.3636363636363636);
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
