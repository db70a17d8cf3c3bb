#include "van_der_pol_real.h"

void van_der_pol_start_parts(const R *restrict p, R *restrict parts)
{
    (void)p;
    parts[0] = K(0.1);
    parts[1] = K(0.0);
    parts[2] = K(0.0);
    parts[3] = K(0.0);
    parts[4] = K(0.0);
    parts[5] = K(0.0);
}

void van_der_pol_motion(R t, const R *restrict p, R *restrict motion)
{
    (void)t;
    (void)p;
    motion[0] = K(0.0);
    motion[1] = K(0.0);
    motion[2] = K(0.0);
    motion[3] = K(0.0);
}

void van_der_pol_switches(R t, R s, const R *restrict p, R *restrict g)
{
    (void)t;
    (void)s;
    (void)p;
    (void)g;
}
