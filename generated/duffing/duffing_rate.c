#include "duffing_real.h"

void duffing_rate(R t, const R *restrict y, const R *restrict p, R *restrict dy)
{
    (void)t;
    dy[0] = y[1];
    const R a1 = K(-2.0) * y[1];
    const R a2 = a1 * p[0];
    const R a3 = a2 * p[1];
    const R a4 = p[0] * p[0];
    const R a5 = y[0] * a4;
    const R a6 = y[0] * y[0];
    const R a7 = (R)(K(0.0) <= y[2]);
    const R a8 = a7 != K(0.0) ? y[2] : K(0.0);
    const R a9 = a6 + a8;
    const R a10 = y[0] * a9;
    const R a11 = y[2] + y[2];
    const R a12 = y[0] * a11;
    const R a13 = a7 != K(0.0) ? a12 : K(0.0);
    const R a14 = a10 + a13;
    const R a15 = a14 * p[2];
    const R a16 = a15 * a4;
    const R a17 = a5 + a16;
    const R a18 = a3 - a17;
    dy[1] = a18;
    const R a20 = y[3] + y[3];
    dy[2] = a20;
    const R a22 = K(-2.0) * p[0];
    const R a23 = a22 * p[1];
    const R a24 = a23 * y[3];
    const R a25 = p[0] * p[0];
    const R a26 = y[0] * y[0];
    const R a27 = a7 != K(0.0) ? y[2] : K(0.0);
    const R a28 = a26 + a27;
    const R a29 = K(3.0) * a28;
    const R a30 = p[2] * a29;
    const R a31 = a30 * a25;
    const R a32 = a25 + a31;
    const R a33 = a32 * y[2];
    const R a34 = a24 - a33;
    const R a35 = a34 + y[4];
    dy[3] = a35;
    const R a37 = a23 * y[4];
    const R a38 = a32 * y[3];
    const R a39 = a37 - a38;
    const R a40 = a39 + a39;
    const R a41 = a40 + p[3];
    dy[4] = a41;
}

void duffing_slope(R t, const R *restrict y, const R *restrict p, R *restrict slope)
{
    (void)t;
    (void)y;
    (void)p;
    slope[0] = K(0.0);
    slope[1] = K(0.0);
    slope[2] = K(0.0);
    slope[3] = K(0.0);
    slope[4] = K(0.0);
}
