#include "quarter_car_damper_real.h"

void quarter_car_damper_start_parts(const R *restrict p, R *restrict parts)
{
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
    parts[11] = K(0.0);
    parts[12] = K(0.0);
    parts[13] = K(0.0);
    parts[14] = K(0.0);
    parts[15] = K(0.0);
    parts[16] = K(0.0);
    parts[17] = K(0.0);
    parts[18] = K(0.0);
    parts[19] = K(0.0);
    parts[20] = K(0.0);
    parts[21] = K(0.0);
    parts[22] = K(0.0);
    parts[23] = K(0.0);
    parts[24] = K(0.0);
    const R a25 = K(0.19739208802178718) * p[8];
    parts[25] = a25;
    parts[26] = K(1.0);
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
