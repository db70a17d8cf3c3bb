#include "stop_and_go_real.h"

void stop_and_go_start_parts(const R *restrict p, R *restrict parts)
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
    const R a35 = K(12.63309363339438) * p[7];
    parts[35] = a35;
    parts[36] = K(0.0);
    parts[37] = K(8.0);
}

void stop_and_go_motion(R t, const R *restrict p, R *restrict motion)
{
    const R a0 = (R)(t < K(3.0));
    const R a1 = K(0.3333333333333333) * p[8];
    const R a2 = a1 * t;
    const R a3 = a0 != K(0.0) ? a2 : K(0.0);
    const R a4 = (R)(a0 == K(0.0));
    const R a5 = (R)(t < K(6.0));
    const R a6 = a5 != K(0.0) ? p[8] : K(0.0);
    const R a7 = (R)(a5 == K(0.0));
    const R a8 = (R)(t < K(8.0));
    const R a9 = K(0.5) * p[8];
    const R a10 = K(8.0) - t;
    const R a11 = a9 * a10;
    const R a12 = a8 != K(0.0) ? a11 : K(0.0);
    const R a13 = (R)(a8 == K(0.0));
    const R a14 = (R)(t < K(10.0));
    const R a15 = (R)(a14 == K(0.0));
    const R a16 = K(0.3333333333333333) * p[8];
    const R a17 = K(-10.0) + t;
    const R a18 = a16 * a17;
    const R a19 = a15 != K(0.0) ? a18 : K(0.0);
    const R a20 = a13 != K(0.0) ? a19 : K(0.0);
    const R a21 = a12 + a20;
    const R a22 = a7 != K(0.0) ? a21 : K(0.0);
    const R a23 = a6 + a22;
    const R a24 = a4 != K(0.0) ? a23 : K(0.0);
    const R a25 = a3 + a24;
    motion[0] = a25;
    const R a27 = (R)(t < K(3.0));
    const R a28 = K(0.3333333333333333) * p[8];
    const R a29 = a27 != K(0.0) ? a28 : K(0.0);
    const R a30 = (R)(a27 == K(0.0));
    const R a31 = (R)(t < K(6.0));
    const R a32 = (R)(a31 == K(0.0));
    const R a33 = (R)(t < K(8.0));
    const R a34 = K(-0.5) * p[8];
    const R a35 = a33 != K(0.0) ? a34 : K(0.0);
    const R a36 = (R)(a33 == K(0.0));
    const R a37 = (R)(t < K(10.0));
    const R a38 = (R)(a37 == K(0.0));
    const R a39 = a38 != K(0.0) ? a28 : K(0.0);
    const R a40 = a36 != K(0.0) ? a39 : K(0.0);
    const R a41 = a35 + a40;
    const R a42 = a32 != K(0.0) ? a41 : K(0.0);
    const R a43 = a30 != K(0.0) ? a42 : K(0.0);
    const R a44 = a29 + a43;
    motion[1] = a44;
    const R a46 = K(-1.3333333333333333) * p[8];
    const R a47 = M(fmax)(K(3.0), t);
    const R a48 = M(fmin)(K(6.0), a47);
    const R a49 = p[8] * a48;
    const R a50 = a46 + a49;
    const R a51 = K(4.0) * p[8];
    const R a52 = M(fmax)(K(6.0), t);
    const R a53 = M(fmin)(K(8.0), a52);
    const R a54 = a51 * a53;
    const R a55 = a50 + a54;
    const R a56 = K(-3.3333333333333335) * p[8];
    const R a57 = M(fmax)(K(10.0), t);
    const R a58 = a56 * a57;
    const R a59 = a55 + a58;
    const R a60 = K(-0.25) * p[8];
    const R a61 = a53 * a53;
    const R a62 = a60 * a61;
    const R a63 = a59 + a62;
    const R a64 = K(0.16666666666666666) * p[8];
    const R a65 = a57 * a57;
    const R a66 = a64 * a65;
    const R a67 = a63 + a66;
    const R a68 = K(0.16666666666666666) * p[8];
    const R a69 = M(fmax)(K(0.0), t);
    const R a70 = M(fmin)(K(3.0), a69);
    const R a71 = a70 * a70;
    const R a72 = a68 * a71;
    const R a73 = a67 + a72;
    motion[2] = a73;
    motion[3] = K(0.0);
}

void stop_and_go_switches(R t, R s, const R *restrict p, R *restrict g)
{
    (void)s;
    (void)p;
    const R a0 = K(-10.0) + t;
    g[0] = a0;
    const R a2 = K(-8.0) + t;
    g[1] = a2;
    const R a4 = K(-6.0) + t;
    g[2] = a4;
    const R a6 = K(-3.0) + t;
    g[3] = a6;
}
