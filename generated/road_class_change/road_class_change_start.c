#include "road_class_change_real.h"

void road_class_change_initial(const R *restrict p, R *restrict y)
{
    y[0] = K(0.0);
    y[1] = K(0.0);
    y[2] = K(0.0);
    y[3] = K(0.0);
    y[4] = K(0.0);
    y[5] = K(0.0);
    const R a6 = (R)(K(0.0) < p[8]);
    const R a7 = a6 != K(0.0) ? p[6] : K(0.0);
    const R a8 = (R)(a6 == K(0.0));
    const R a9 = a8 != K(0.0) ? p[7] : K(0.0);
    const R a10 = a7 + a9;
    const R a11 = K(-9.864788785090996) * a10;
    const R a12 = a11 / K(12.65007471297709);
    const R a13 = K(-1.414213562373095) * a12;
    const R a14 = K(9.876202908444764) * a12;
    const R a15 = K(-7.701666424986703) * a10;
    const R a16 = a14 - a15;
    const R a17 = a16 / K(2.499532834853305);
    const R a18 = K(5.727564927611034) * a17;
    const R a19 = a13 - a18;
    const R a20 = K(2.2082178034163027) * a12;
    const R a21 = K(-1.7220137205855934) * a10;
    const R a22 = a20 - a21;
    const R a23 = K(-5.310116345946687) * a17;
    const R a24 = a22 - a23;
    const R a25 = a24 / K(5.868986283848344);
    const R a26 = K(5.727564927611034) * a25;
    const R a27 = a19 - a26;
    const R a28 = a27 / K(1.1313708498984762);
    y[6] = a28;
    y[7] = a28;
    y[8] = K(0.0);
    y[9] = K(0.0);
    y[10] = a28;
    const R a34 = a17 + a25;
    const R a35 = a34 / K(2.0);
    y[11] = a35;
    y[12] = a28;
    y[13] = K(0.0);
    y[14] = K(0.0);
    y[15] = a28;
    y[16] = a35;
    y[17] = K(0.0);
    y[18] = K(0.0);
    y[19] = K(0.0);
    y[20] = K(0.0);
    y[21] = K(0.0);
    y[22] = K(0.0);
    y[23] = K(0.0);
    y[24] = a28;
    const R a50 = a25 + a17;
    const R a51 = a50 / K(2.0);
    y[25] = a51;
    const R a53 = -a12;
    y[26] = a53;
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
    const R a1 = s - p[9];
    g[1] = a1;
    const R a3 = p[10] + p[9];
    const R a4 = a3 - s;
    g[2] = a4;
    const R a6 = p[8] - s;
    g[3] = a6;
}
