#include "road_class_change_real.h"

void road_class_change_start_parts(const R *restrict p, R *restrict parts)
{
    parts[0] = K(0.0);
    parts[1] = K(0.0);
    parts[2] = K(0.0);
    parts[3] = K(0.0);
    parts[4] = K(1.0);
    parts[5] = K(1.0);
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
    parts[25] = K(0.0);
    parts[26] = K(0.0);
    parts[27] = K(0.0);
    parts[28] = K(0.0);
    parts[29] = K(-0.8);
    parts[30] = K(1.0);
    parts[31] = K(-8.1);
    parts[32] = K(0.0);
    parts[33] = K(0.0);
    parts[34] = K(0.0);
    const R a35 = (R)(K(0.0) < p[8]);
    const R a36 = a35 != K(0.0) ? p[6] : K(0.0);
    const R a37 = (R)(a35 == K(0.0));
    const R a38 = a37 != K(0.0) ? p[7] : K(0.0);
    const R a39 = a36 + a38;
    const R a40 = K(12.63309363339438) * a39;
    parts[35] = a40;
    parts[36] = K(0.0);
    parts[37] = K(8.0);
}

void road_class_change_motion(R t, const R *restrict p, R *restrict motion)
{
    motion[0] = p[12];
    motion[1] = K(0.0);
    const R a2 = p[12] * t;
    motion[2] = a2;
    motion[3] = K(0.0);
}

void road_class_change_switches(R t, R s, const R *restrict p, R *restrict g)
{
    (void)t;
    g[0] = s;
    const R a1 = p[8] - s;
    g[1] = a1;
    const R a3 = s - p[9];
    g[2] = a3;
    const R a5 = p[10] + p[9];
    const R a6 = a5 - s;
    g[3] = a6;
}
