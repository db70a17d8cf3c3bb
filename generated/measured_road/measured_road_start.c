#include "measured_road_real.h"

void measured_road_initial(const R *restrict p, R *restrict y)
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
    y[20] = K(0.0);
    y[21] = K(0.0);
    y[22] = K(0.0);
    y[23] = K(0.0);
    y[24] = K(0.0);
    y[25] = K(0.0);
    y[26] = K(0.0);
    y[27] = K(0.0);
    y[28] = K(0.0);
    y[29] = K(0.0);
    y[30] = K(0.0);
    y[31] = K(0.0);
    y[32] = K(0.0);
    y[33] = K(0.0);
    y[34] = K(0.024656538375572145);
    y[35] = K(8.962048999340813e-21);
    y[36] = K(0.02416885837947342);
    y[37] = K(-6.311674358972546e-05);
    y[38] = K(0.00017208304186295696);
    y[39] = K(6.311674358972553e-05);
    y[40] = K(0.00017850791882636276);
    y[41] = K(0.02374381822854572);
    y[42] = K(-4.507550685520384e-21);
    y[43] = K(0.0002022498330227305);
}

void measured_road_motion(R t, const R *restrict p, R *restrict motion)
{
    motion[0] = p[7];
    motion[1] = K(0.0);
    const R a2 = p[7] * t;
    motion[2] = a2;
    motion[3] = K(0.0);
}

void measured_road_switches(R t, R s, const R *restrict p, R *restrict g)
{
    (void)t;
    (void)s;
    (void)p;
    (void)g;
}
