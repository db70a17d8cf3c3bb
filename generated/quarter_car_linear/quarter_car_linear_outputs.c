#include "quarter_car_linear_real.h"

void quarter_car_linear_outputs(R t, const R *restrict y, const R *restrict p, R *restrict mean, R *restrict variance)
{
    (void)t;
    mean[0] = y[0];
    mean[1] = y[1];
    const R a2 = p[3] / p[0];
    const R a3 = a2 * y[3];
    const R a4 = p[2] / p[0];
    const R a5 = a4 * y[0];
    const R a6 = p[3] / p[0];
    const R a7 = a6 * y[2];
    const R a8 = a5 + a7;
    const R a9 = a3 - a8;
    mean[2] = a9;
    const R a11 = p[4] * y[1];
    mean[3] = a11;
    variance[0] = y[5];
    variance[1] = y[10];
    const R a15 = a2 * y[17];
    const R a16 = a4 * y[8];
    const R a17 = a6 * y[15];
    const R a18 = a16 + a17;
    const R a19 = a15 - a18;
    const R a20 = a19 * a2;
    const R a21 = a2 * y[8];
    const R a22 = a4 * y[5];
    const R a23 = a6 * y[7];
    const R a24 = a22 + a23;
    const R a25 = a21 - a24;
    const R a26 = a25 * a4;
    const R a27 = a2 * y[15];
    const R a28 = a4 * y[7];
    const R a29 = a6 * y[14];
    const R a30 = a28 + a29;
    const R a31 = a27 - a30;
    const R a32 = a31 * a6;
    const R a33 = a26 + a32;
    const R a34 = a20 - a33;
    variance[2] = a34;
    const R a36 = p[4] * y[10];
    const R a37 = a36 * p[4];
    variance[3] = a37;
}
