#include "van_der_pol_real.h"

void van_der_pol_held_rate(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict dy)
{
    (void)t;
    (void)s;
    (void)V;
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

void van_der_pol_held_jacobian(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict values)
{
    (void)t;
    (void)s;
    (void)V;
    const R a0 = y[0] * y[1];
    const R a1 = a0 + y[3];
    const R a2 = y[0] * y[1];
    const R a3 = a1 + a2;
    const R a4 = a3 + y[3];
    const R a5 = p[0] * a4;
    const R a6 = K(-1.0) - a5;
    values[0] = a6;
    const R a8 = y[1] + y[1];
    const R a9 = p[0] * a8;
    const R a10 = y[2] * a9;
    const R a11 = y[0] + y[0];
    const R a12 = p[0] * a11;
    const R a13 = y[3] * a12;
    const R a14 = a10 + a13;
    const R a15 = -a14;
    values[1] = a15;
    const R a17 = y[3] * a9;
    const R a18 = y[4] * a12;
    const R a19 = a17 + a18;
    const R a20 = -a19;
    const R a21 = a20 + a20;
    values[2] = a21;
    values[3] = K(1.0);
    const R a24 = y[0] * y[0];
    const R a25 = a24 + y[2];
    const R a26 = p[0] * a25;
    const R a27 = p[0] - a26;
    values[4] = a27;
    const R a29 = y[0] + y[0];
    const R a30 = p[0] * a29;
    const R a31 = y[2] * a30;
    const R a32 = -a31;
    values[5] = a32;
    const R a34 = y[3] * a30;
    const R a35 = -a34;
    const R a36 = a35 + a35;
    values[6] = a36;
    const R a38 = p[0] * y[1];
    const R a39 = -a38;
    values[7] = a39;
    const R a41 = a1 + a1;
    const R a42 = a41 * p[0];
    const R a43 = K(-1.0) - a42;
    const R a44 = y[3] * p[0];
    const R a45 = a43 - a44;
    values[8] = a45;
    const R a47 = y[4] * p[0];
    const R a48 = -a47;
    const R a49 = a48 + a48;
    values[9] = a49;
    const R a51 = y[0] + y[0];
    const R a52 = p[0] * a51;
    const R a53 = -a52;
    values[10] = a53;
    values[11] = K(2.0);
    const R a56 = y[0] * y[0];
    const R a57 = a56 + y[2];
    const R a58 = a57 * p[0];
    const R a59 = p[0] - a58;
    const R a60 = p[0] + p[0];
    const R a61 = y[2] * a60;
    const R a62 = a59 - a61;
    values[12] = a62;
    const R a64 = y[3] * a60;
    const R a65 = a43 - a64;
    const R a66 = a65 + a65;
    values[13] = a66;
    values[14] = K(1.0);
    const R a69 = a59 + a59;
    values[15] = a69;
}

void van_der_pol_held_outputs(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict mean, R *restrict variance)
{
    (void)t;
    (void)s;
    (void)V;
    (void)p;
    mean[0] = y[0];
    variance[0] = y[2];
}
