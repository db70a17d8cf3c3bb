#include "quarter_car_damper_real.h"

void quarter_car_damper_initial(const R *restrict p, R *restrict y)
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
    y[11] = K(0.0);
    y[12] = K(0.0);
    y[13] = K(0.0);
    y[14] = K(0.0);
    y[15] = K(0.0);
    y[16] = K(0.0);
    y[17] = K(0.0);
    y[18] = K(0.0);
    y[19] = K(0.0);
}

void quarter_car_damper_motion(R t, const R *restrict p, R *restrict motion)
{
    motion[0] = p[9];
    motion[1] = K(0.0);
    const R a2 = p[9] * t;
    motion[2] = a2;
    motion[3] = K(0.0);
}

void quarter_car_damper_switches(R t, R s, const R *restrict p, R *restrict g)
{
    (void)t;
    (void)s;
    (void)p;
    (void)g;
}
