#include "van_der_pol_real.h"

void van_der_pol_rate(R t, const R *restrict y, const R *restrict p, R *restrict dy)
{
    (void)t;
    dy[0] = y[1];
    const R a1 = y[1] * p[0];
    const R a2 = a1 - y[0];
    const R a3 = y[0] * y[1];
    const R a4 = a3 + y[3];
    const R a5 = y[0] * a4;
    const R a6 = y[2] * y[1];
    const R a7 = a5 + a6;
    const R a8 = y[3] * y[0];
    const R a9 = a7 + a8;
    const R a10 = a9 * p[0];
    const R a11 = a2 - a10;
    dy[1] = a11;
    const R a13 = y[3] + y[3];
    dy[2] = a13;
    const R a15 = a4 + a4;
    const R a16 = a15 * p[0];
    const R a17 = K(-1.0) - a16;
    const R a18 = a17 * y[2];
    const R a19 = y[0] * y[0];
    const R a20 = a19 + y[2];
    const R a21 = a20 * p[0];
    const R a22 = p[0] - a21;
    const R a23 = a22 * y[3];
    const R a24 = a18 + a23;
    const R a25 = a24 + y[4];
    dy[3] = a25;
    const R a27 = a17 * y[3];
    const R a28 = a22 * y[4];
    const R a29 = a27 + a28;
    const R a30 = a29 + a29;
    const R a31 = a30 + p[1];
    dy[4] = a31;
}

void van_der_pol_slope(R t, const R *restrict y, const R *restrict p, R *restrict slope)
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
